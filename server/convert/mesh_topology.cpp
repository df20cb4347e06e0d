// The constant parts of a mesh: triangles or curves, attributes, parts, skin, morph targets,
// metadata.
#include <fmt/format.h>

#include <set>

#include "renderer/scene/strands.h"
#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr double kWeightTolerance = 1e-3;
constexpr u64 kLargestCount = 0xfffffffeu;  // triangles: 2^32 - 2
// Metres. The squares of what is computed with them fit a float.
constexpr float kLeastRadius = 1e-12f, kLargestRadius = 1e12f;

Expected<ArrayOf<uvec3>> read_triangles(const v1::Array& array, u32 vertices, ArraySource& source) {
  if (array.shape_size() > 0 && (array.shape(0) < 1 || array.shape(0) > kLargestCount))
    return fail(
        Code::kInvalidArgument, "shape",
        fmt::format("is {}; send (F, 3), F from 1 to {}", shape_text(array), kLargestCount));
  auto triangles = read_integers<uvec3>(array, source, {{"F", {}}, kThree}, v1::D_TYPE_U32);
  if (!triangles) return triangles;
  const std::span numbers(reinterpret_cast<const u32*>(triangles->data()), triangles->size() * 3);
  HELIO_TRY(check_below(numbers, vertices, 3, "vertices"));
  return triangles;
}

/// Strands of 2 points and more, which have all of the points.
Status check_strands(std::span<const u32> curves, u64 points) {
  u64 sum = 0;
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (curves[i] < 2)
      return fail(Code::kInvalidArgument, indexed("", i),
                  fmt::format("is {}; a strand has 2 points or more", curves[i]));
    sum += curves[i];
  }
  if (sum == points) return {};
  return fail(Code::kInvalidArgument, "",
              fmt::format("sums to {} points; positions has {}", sum, points));
}

Status check_radii(std::span<const float> radii) {
  for (std::size_t i = 0; i < radii.size(); ++i)
    if (!(radii[i] >= kLeastRadius && radii[i] <= kLargestRadius))
      return fail(Code::kInvalidArgument, indexed("", i),
                  fmt::format("is {}; radii are from {} to {} metres", radii[i], kLeastRadius,
                              kLargestRadius));
  return {};
}

Status read_strands(const v1::Mesh& message, ArraySource& source, MeshTopology& topology) {
  if (message.curves().shape_size() > 0 && message.curves().shape(0) == 0)
    return fail(Code::kInvalidArgument, "curves.shape",
                "is (0); send the points of 1 strand or more");
  HELIO_TAKE(topology.curves,
             read_integers<u32>(message.curves(), source, {{"S", {}}}, v1::D_TYPE_U32), "curves");
  HELIO_CHECK(check_strands(topology.curves.span(), topology.vertex_count), "curves");
  HELIO_TAKE(topology.radii,
             read_floats<float>(message.radii(), source, {{"V", topology.vertex_count}}), "radii");
  HELIO_CHECK(check_radii(topology.radii.span()), "radii");
  topology.triangles = ArrayOf(segments_of(topology.curves.span()));
  return {};
}

void add_strands(const MeshTopology& topology, const ArraySink& sink, v1::Mesh& message) {
  const std::vector<u64> strands{topology.curves.size()}, points{topology.vertex_count};
  *message.mutable_curves() = to_array(topology.curves.buffer(), v1::D_TYPE_U32, strands, sink);
  *message.mutable_radii() = to_array(topology.radii.buffer(), v1::D_TYPE_F32, points, sink);
}

template <class T>
ArrayOf<vec4> widen(const RawArray& raw, float scale) {
  const auto in = raw.as<T>();
  const std::size_t channels = raw.shape[1];
  std::vector<vec4> out(raw.shape[0], vec4(1));
  for (std::size_t i = 0; i < out.size(); ++i)
    for (std::size_t c = 0; c < channels; ++c) out[i][int(c)] = float(in[i * channels + c]) * scale;
  return ArrayOf<vec4>(std::move(out));
}

Expected<ArrayOf<vec4>> read_colors(const v1::Array& array, u32 vertices, ArraySource& source) {
  static constexpr std::array kTypes{v1::D_TYPE_F32, v1::D_TYPE_F64, v1::D_TYPE_U8, v1::D_TYPE_U16};
  const bool rgb = array.shape_size() == 2 && array.shape(1) == 3;
  const Dims dims{{"V", vertices}, rgb ? kThree : kFour};
  const u64 channels = rgb ? 3 : 4;
  if (array.dtype() == v1::D_TYPE_U8 || array.dtype() == v1::D_TYPE_U16) {
    auto raw = read_raw(array, source, dims, kTypes);
    if (!raw) return std::unexpected(std::move(raw).error());
    return raw->type == v1::D_TYPE_U8 ? widen<u8>(*raw, 1 / 255.f) : widen<u16>(*raw, 1 / 65535.f);
  }
  auto raw = read_f32(array, source, dims, channels);
  if (!raw) return std::unexpected(std::move(raw).error());
  return rgb ? widen<float>(*raw, 1) : ArrayOf<vec4>(raw->buffer);
}

Status read_parts(const v1::Mesh& message, ArraySource& source, MeshTopology& topology) {
  const u64 triangles = topology.triangles.size();
  topology.part_names = {message.part_names().begin(), message.part_names().end()};
  const u64 named = topology.part_names.size();
  if (message.has_parts()) {
    HELIO_TAKE(topology.parts,
               read_integers<u32>(message.parts(), source, {{"F", triangles}}, v1::D_TYPE_U32),
               "parts");
    const u32 end = u32(std::max(triangles, named));
    HELIO_CHECK(check_below(topology.parts.span(), end, 1, "part numbers for so many triangles"),
                "parts");
    topology.part_count = 1 + std::ranges::max(topology.parts.span());
  }
  if (named > 0 && named < topology.part_count)
    return fail(
        Code::kInvalidArgument, "part_names",
        fmt::format("has {} names; give one for each of the {} parts", named, topology.part_count));
  topology.part_count = std::max(topology.part_count, u32(named));
  return {};
}

Status check_weights(std::span<const vec4> weights) {
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const vec4 w = weights[i];
    const double sum = double(w.x) + w.y + w.z + w.w;
    if (std::abs(sum - 1) > kWeightTolerance || std::min({w.x, w.y, w.z, w.w}) < 0)
      return fail(
          Code::kInvalidArgument, indexed("", i),
          fmt::format("is {} {} {} {}; weights are not negative and sum to 1", w.x, w.y, w.z, w.w));
  }
  return {};
}

Status read_skin(const v1::Mesh& message, ArraySource& source, MeshTopology& topology) {
  if (message.has_joints() != message.has_weights())
    return fail(Code::kInvalidArgument, message.has_joints() ? "weights" : "joints",
                "is missing; joints and weights are sent together");
  if (!message.has_joints()) return {};
  const Dims dims{{"V", topology.vertex_count}, kFour};
  HELIO_TAKE(topology.joints,
             read_integers<glm::u16vec4>(message.joints(), source, dims, v1::D_TYPE_U16), "joints");
  HELIO_TAKE(topology.weights, read_floats<vec4>(message.weights(), source, dims), "weights");
  HELIO_CHECK(check_weights(topology.weights.span()), "weights");
  return {};
}

Status read_morphs(const v1::Mesh& message, ArraySource& source, MeshTopology& topology) {
  if (!message.has_morph_positions()) {
    if (!message.has_morph_normals()) return {};
    return fail(Code::kInvalidArgument, "morph_positions",
                "is missing; morph_normals are sent together with morph_positions");
  }
  const Dim vertices{"V", topology.vertex_count};
  HELIO_TAKE(topology.morph_positions,
             read_floats<vec3>(message.morph_positions(), source, {{"T", {}}, vertices, kThree}),
             "morph_positions");
  topology.morph_count = u32(topology.morph_positions.size() / topology.vertex_count);
  if (topology.morph_count == 0)
    return fail(Code::kInvalidArgument, "morph_positions.shape",
                "has no morph target; leave morph_positions out");
  if (!message.has_morph_normals()) return {};
  const Dims dims{{"T", topology.morph_count}, vertices, kThree};
  HELIO_TAKE(topology.morph_normals, read_floats<vec3>(message.morph_normals(), source, dims),
             "morph_normals");
  return {};
}

Status read_keypoints(const v1::Mesh& message, ArraySource& source, MeshTopology& topology) {
  std::set<std::string_view> names;
  for (int i = 0; i < message.keypoints_size(); ++i) {
    const v1::Keypoint& keypoint = message.keypoints(i);
    const std::string field = indexed("keypoints", u64(i));
    if (keypoint.name().empty() || !names.insert(keypoint.name()).second)
      return fail(Code::kInvalidArgument, field + ".name",
                  fmt::format("'{}' is empty or taken; give each keypoint a name of its own",
                              keypoint.name()));
    Keypoint& out = topology.keypoints.emplace_back(Keypoint{keypoint.name()});
    HELIO_TAKE(out.position, to_vec3(keypoint.position(), kAnyFinite), field + ".position");
  }
  if (!message.has_skeleton()) return {};
  HELIO_TAKE(topology.skeleton,
             read_integers<uvec2>(message.skeleton(), source, {{"E", {}}, kTwo}, v1::D_TYPE_U32),
             "skeleton");
  const std::span numbers(reinterpret_cast<const u32*>(topology.skeleton.data()),
                          topology.skeleton.size() * 2);
  HELIO_CHECK(check_below(numbers, u32(topology.keypoints.size()), 2, "keypoints"), "skeleton");
  return {};
}

Expected<Symmetry> to_symmetry(const v1::Symmetry& message, ArraySource& source) {
  Symmetry symmetry;
  if (message.has_matrix() == message.has_axis())
    return fail(Code::kInvalidArgument, "", "give either matrix or axis");
  if (message.has_matrix()) {
    std::vector<mat4x3> matrix;
    HELIO_TAKE(matrix, read_poses(message.matrix(), source, {kFour, kFour}), "matrix");
    symmetry.matrix = mat4(matrix[0]);
    if (message.has_offset())
      return fail(Code::kInvalidArgument, "offset", "belongs to an axis; leave it out");
    return symmetry;
  }
  HELIO_TAKE(symmetry.axis, to_vec3(message.axis(), kAnyFinite), "axis");
  if (glm::dot(symmetry.axis, symmetry.axis) == 0)
    return fail(Code::kInvalidArgument, "axis", "has no length; give a direction");
  if (message.has_offset())
    HELIO_TAKE(symmetry.offset, to_vec3(message.offset(), kAnyFinite), "offset");
  return symmetry;
}

v1::Symmetry symmetry_to_proto(const Symmetry& symmetry, const ArraySink& sink) {
  v1::Symmetry message;
  if (symmetry.matrix) {
    const mat4x3 affine(*symmetry.matrix);
    *message.mutable_matrix() = to_array(std::span(&affine, 1), true, sink);
    return message;
  }
  *message.mutable_axis() = to_proto(symmetry.axis);
  *message.mutable_offset() = to_proto(symmetry.offset);
  return message;
}

}  // namespace

Expected<MeshTopology> to_topology(const v1::Mesh& message, u32 vertex_count, ArraySource& source) {
  MeshTopology topology{.vertex_count = vertex_count};
  const Dim vertices{"V", vertex_count};
  if (message.has_uvs())
    HELIO_TAKE(topology.uvs, read_floats<vec2>(message.uvs(), source, {vertices, kTwo}), "uvs");
  if (message.has_curves())
    HELIO_TRY(read_strands(message, source, topology));
  else
    HELIO_TAKE(topology.triangles, read_triangles(message.indices(), vertex_count, source),
               "indices");
  if (message.has_uvs1())
    HELIO_TAKE(topology.uvs1, read_floats<vec2>(message.uvs1(), source, {vertices, kTwo}), "uvs1");
  if (message.has_colors())
    HELIO_TAKE(topology.colors, read_colors(message.colors(), vertex_count, source), "colors");
  if (message.has_tangents())
    HELIO_TAKE(topology.tangents, read_floats<vec4>(message.tangents(), source, {vertices, kFour}),
               "tangents");
  HELIO_TRY(read_parts(message, source, topology));
  HELIO_TRY(read_skin(message, source, topology));
  HELIO_TRY(read_morphs(message, source, topology));
  HELIO_TRY(read_keypoints(message, source, topology));
  for (int i = 0; i < message.symmetries_size(); ++i)
    HELIO_TAKE(topology.symmetries.emplace_back(), to_symmetry(message.symmetries(i), source),
               indexed("symmetries", u64(i)));
  return topology;
}

void add_topology(const MeshTopology& topology, const ArraySink& sink, v1::Mesh& message) {
  const u64 vertices = topology.vertex_count, triangles = topology.triangles.size();
  const auto add = [&](const auto& array, v1::DType type, std::vector<u64> shape) {
    return to_array(array.buffer(), type, shape, sink);
  };
  const auto f32 = v1::D_TYPE_F32;
  if (topology.curves.empty())
    *message.mutable_indices() = add(topology.triangles, v1::D_TYPE_U32, {triangles, 3});
  else
    add_strands(topology, sink, message);
  if (!topology.uvs.empty()) *message.mutable_uvs() = add(topology.uvs, f32, {vertices, 2});
  if (!topology.uvs1.empty()) *message.mutable_uvs1() = add(topology.uvs1, f32, {vertices, 2});
  if (!topology.colors.empty())
    *message.mutable_colors() = add(topology.colors, f32, {vertices, 4});
  if (!topology.tangents.empty())
    *message.mutable_tangents() = add(topology.tangents, f32, {vertices, 4});
  if (!topology.parts.empty())
    *message.mutable_parts() = add(topology.parts, v1::D_TYPE_U32, {triangles});
  message.mutable_part_names()->Add(topology.part_names.begin(), topology.part_names.end());
  if (!topology.joints.empty()) {
    *message.mutable_joints() = add(topology.joints, v1::D_TYPE_U16, {vertices, 4});
    *message.mutable_weights() = add(topology.weights, f32, {vertices, 4});
  }
  const std::vector<u64> morphs{topology.morph_count, vertices, 3};
  if (!topology.morph_positions.empty())
    *message.mutable_morph_positions() = add(topology.morph_positions, f32, morphs);
  if (!topology.morph_normals.empty())
    *message.mutable_morph_normals() = add(topology.morph_normals, f32, morphs);
  for (const Keypoint& keypoint : topology.keypoints) {
    v1::Keypoint* out = message.add_keypoints();
    out->set_name(keypoint.name);
    *out->mutable_position() = to_proto(keypoint.position);
  }
  if (!topology.skeleton.empty())
    *message.mutable_skeleton() =
        add(topology.skeleton, v1::D_TYPE_U32, {topology.skeleton.size(), 2});
  for (const Symmetry& symmetry : topology.symmetries)
    *message.add_symmetries() = symmetry_to_proto(symmetry, sink);
}

}  // namespace heliograph::server
