// Volumes: grids, dense or in bricks, and the look of the medium.
#include <fmt/format.h>

#include "renderer/scene/grid.h"
#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr Range kDensityScale{0, 1e9}, kTemperatureScale{0, 1e9}, kEmissionScale{0, 1e15};
constexpr Range kUnit{0, 1}, kAnisotropy{-0.99, 0.99};
constexpr Dim kBrick{"", kBrickSide};

constexpr std::array<Clear<PutVolume>, 7> kClear{{
    {"temperature", [](PutVolume& p) { p.temperature.emplace(nullptr); }},
    {"color", [](PutVolume& p) { p.color.emplace(nullptr); }},
    {"density_scale", [](PutVolume& p) { p.density_scale = Volume{}.density_scale; }},
    {"albedo", [](PutVolume& p) { p.albedo = Volume{}.albedo; }},
    {"anisotropy", [](PutVolume& p) { p.anisotropy = Volume{}.anisotropy; }},
    {"temperature_scale", [](PutVolume& p) { p.temperature_scale = Volume{}.temperature_scale; }},
    {"emission_scale", [](PutVolume& p) { p.emission_scale = Volume{}.emission_scale; }},
}};

/// Channels and range of a grid's values.
struct GridKind {
  u32 channels;
  Range range;
};
constexpr GridKind kDensity{1, kNotNegative}, kTemperature{1, kNotNegative}, kColor{3, kUnit};

Status check_values(const RawArray& raw, const GridKind& kind) {
  const auto outside = [&](float v) {
    return !(double(v) >= kind.range.low && double(v) <= kind.range.high);
  };
  const auto values = raw.as<float>();
  const auto bad = std::ranges::find_if(values, outside);
  if (bad == values.end()) return {};
  const std::string most = kind.range.high > 1 ? "or more" : fmt::format("to {}", kind.range.high);
  return bad_element(raw, u64(bad - values.begin()), 1,
                     fmt::format("is {}; give {} {}", *bad, kind.range.low, most));
}

/// Checks the box of a grid: not too many bricks, and voxels distinguishable in f32.
Status check_box(ivec3 lower, ivec3 upper, std::string_view field) {
  for (int i = 0; i < 3; ++i)
    if (lower[i] < -kLargestVoxel || upper[i] > kLargestVoxel || lower[i] >= upper[i])
      return fail(Code::kInvalidArgument, std::string(field),
                  fmt::format("spans voxels {} to {} of axis {}; give at least one, within {} of 0",
                              lower[i], upper[i], i, kLargestVoxel));
  const u64 bricks = brick_range(lower, upper).size();
  if (bricks <= kMostBricks) return {};
  return std::unexpected(
      Error{.code = Code::kResourceExhausted,
            .message = fmt::format("spans {} bricks of 8^3 voxels, {} may be; use larger voxels, "
                                   "or several volumes",
                                   bricks, kMostBricks),
            .where = std::string(field),
            .needed = bricks,
            .available = kMostBricks});
}

Dims with_channels(Dims dims, const GridKind& kind) {
  if (kind.channels > 1) dims.push_back({"", kind.channels});
  return dims;
}

Expected<Grid> to_dense(const v1::Grid& message, const GridKind& kind, ArraySource& source) {
  if (message.has_box())
    return fail(Code::kInvalidArgument, "box", "goes with bricks; leave it out of a dense grid");
  const v1::Array& array = message.values();
  RawArray raw;
  HELIO_TAKE(raw,
             read_f32(array, source, with_channels({{"X", {}}, {"Y", {}}, {"Z", {}}}, kind), 1),
             "values");
  ivec3 size;
  for (int i = 0; i < 3; ++i)
    size[i] = i32(std::min<u64>(raw.shape[std::size_t(i)], kLargestVoxel + 1ull));
  HELIO_TRY(check_box(ivec3(0), size, "values.shape"));
  HELIO_CHECK(check_values(raw, kind), "values");
  return dense_grid(raw.as<float>(), size, kind.channels);
}

Status check_bricks(std::span<const ivec3> bricks, const Grid& grid) {
  const BrickRange range = brick_range(grid.lower, grid.upper);
  for (std::size_t i = 0; i < bricks.size(); ++i) {
    const ivec3 at = bricks[i] - range.first;
    if (glm::any(glm::lessThan(at, ivec3(0))) || glm::any(glm::greaterThanEqual(at, range.count)))
      return fail(Code::kInvalidArgument, indexed("", i), "lies outside the box");
    if (i > 0 && !brick_before(bricks[i - 1], bricks[i]))
      return fail(Code::kInvalidArgument, indexed("", i),
                  "does not follow the brick before; sort them by x, y, z, each once");
  }
  return {};
}

Expected<Grid> to_sparse(const v1::Grid& message, const GridKind& kind, ArraySource& source) {
  if (!message.has_box()) return fail(Code::kInvalidArgument, "box", "is missing beside bricks");
  Grid grid{.channels = kind.channels};
  ArrayOf<ivec3> box;
  HELIO_TAKE(box, read_integers<ivec3>(message.box(), source, {kTwo, kThree}, v1::D_TYPE_I32),
             "box");
  grid.lower = box[0];
  grid.upper = box[1];
  HELIO_TRY(check_box(grid.lower, grid.upper, "box"));
  HELIO_TAKE(grid.bricks,
             read_integers<ivec3>(message.bricks(), source, {{"B", {}}, kThree}, v1::D_TYPE_I32),
             "bricks");
  HELIO_CHECK(check_bricks(grid.bricks.span(), grid), "bricks");
  RawArray raw;
  const Dims dims = with_channels({{"B", grid.bricks.size()}, kBrick, kBrick, kBrick}, kind);
  HELIO_TAKE(raw, read_f32(message.values(), source, dims, 1), "values");
  HELIO_CHECK(check_values(raw, kind), "values");
  grid.values = ArrayOf<float>(raw.buffer);
  return grid;
}

Expected<std::shared_ptr<const Grid>> to_grid(const v1::Grid& message, const GridKind& kind,
                                              ArraySource& source) {
  auto grid =
      message.has_bricks() ? to_sparse(message, kind, source) : to_dense(message, kind, source);
  if (!grid) return std::unexpected(std::move(grid).error());
  if (message.has_transform()) {
    std::vector<mat4x3> transform;
    HELIO_TAKE(transform, read_poses(message.transform(), source, {kFour, kFour}), "transform");
    grid->object_from_voxel = transform[0];
  }
  return std::make_shared<const Grid>(std::move(*grid));
}

void write_grid(const Grid& grid, const ArraySink& sink, v1::Grid& message) {
  const u64 count = grid.bricks.size();
  const u64 bricks_shape[] = {count, 3}, box_shape[] = {2, 3};
  std::vector<u64> values_shape{count, kBrickSide, kBrickSide, kBrickSide};
  if (grid.channels > 1) values_shape.push_back(grid.channels);
  *message.mutable_values() = to_array(grid.values.buffer(), v1::D_TYPE_F32, values_shape, sink);
  *message.mutable_bricks() = to_array(grid.bricks.buffer(), v1::D_TYPE_I32, bricks_shape, sink);
  *message.mutable_box() = to_array(ArrayOf<ivec3>(std::vector{grid.lower, grid.upper}).buffer(),
                                    v1::D_TYPE_I32, box_shape, sink);
  *message.mutable_transform() = to_array(std::span(&grid.object_from_voxel, 1), true, sink);
}

}  // namespace

Expected<PutVolume> to_volume(const v1::Volume& message, ArraySource& source) {
  PutVolume patch;
  HELIO_TRY(clear_fields(message.clear(), kClear, patch));
  if (message.has_density())
    HELIO_TAKE(patch.density, to_grid(message.density(), kDensity, source), "density");
  if (message.has_temperature())
    HELIO_TAKE(patch.temperature, to_grid(message.temperature(), kTemperature, source),
               "temperature");
  if (message.has_color())
    HELIO_TAKE(patch.color, to_grid(message.color(), kColor, source), "color");
  if (message.has_density_scale())
    HELIO_TAKE(patch.density_scale, in_range(message.density_scale(), kDensityScale),
               "density_scale");
  if (message.has_albedo()) HELIO_TAKE(patch.albedo, to_vec3(message.albedo(), kUnit), "albedo");
  if (message.has_anisotropy())
    HELIO_TAKE(patch.anisotropy, in_range(message.anisotropy(), kAnisotropy), "anisotropy");
  if (message.has_temperature_scale())
    HELIO_TAKE(patch.temperature_scale, in_range(message.temperature_scale(), kTemperatureScale),
               "temperature_scale");
  if (message.has_emission_scale())
    HELIO_TAKE(patch.emission_scale, in_range(message.emission_scale(), kEmissionScale),
               "emission_scale");
  return patch;
}

v1::Volume to_proto(const PutVolume& patch, const ArraySink& sink) {
  v1::Volume message;
  if (patch.density) write_grid(*patch.density, sink, *message.mutable_density());
  if (patch.temperature && *patch.temperature)
    write_grid(**patch.temperature, sink, *message.mutable_temperature());
  else if (patch.temperature)
    message.add_clear("temperature");
  if (patch.color && *patch.color)
    write_grid(**patch.color, sink, *message.mutable_color());
  else if (patch.color)
    message.add_clear("color");
  if (patch.density_scale) message.set_density_scale(*patch.density_scale);
  if (patch.albedo) *message.mutable_albedo() = to_proto(*patch.albedo);
  if (patch.anisotropy) message.set_anisotropy(*patch.anisotropy);
  if (patch.temperature_scale) message.set_temperature_scale(*patch.temperature_scale);
  if (patch.emission_scale) message.set_emission_scale(*patch.emission_scale);
  return message;
}

}  // namespace heliograph::server
