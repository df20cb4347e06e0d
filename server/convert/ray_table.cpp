// Ray tables of cameras: checks of rays and times, and the footprint of a pixel.
#include "renderer/scene/ray_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

using kernels::TableRay;

constexpr float kFarthestOrigin = 1e6f;  // metres
constexpr float kShortest = 1e-6f, kLongest = 1e6f;
constexpr float kLatest = 1000;  // seconds

bool sees(const TableRay& ray) { return ray.direction != vec3(0); }

std::string place_of(u64 pixel, u32 width, const char* field) {
  return fmt::format("{}[{}][{}]", field, pixel / width, pixel % width);
}

Status check_ray(const TableRay& ray, const std::string& where) {
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(ray.origin[axis]) <= kFarthestOrigin))
      return fail(Code::kInvalidArgument, where,
                  fmt::format("begins at {:g} m along an axis; give origins within {:g} m of the "
                              "camera",
                              ray.origin[axis], kFarthestOrigin));
  if (!sees(ray)) return {};
  const double length = glm::length(glm::dvec3(ray.direction));
  if (length >= kShortest && length <= kLongest) return {};
  return fail(Code::kInvalidArgument, where,
              fmt::format("has a direction of length {:g}; give a length in [{:g}, {:g}], or zeros "
                          "where the pixel sees nothing",
                          length, kShortest, kLongest));
}

Status check_rays(std::span<const TableRay> rays, u32 width) {
  for (u64 i = 0; i < rays.size(); ++i) HELIO_TRY(check_ray(rays[i], place_of(i, width, "rays")));
  if (std::ranges::any_of(rays, sees)) return {};
  return fail(Code::kInvalidArgument, "rays",
              "has zeros for all directions; give at least one pixel a ray");
}

Status check_times(std::span<const float> times, u32 width) {
  for (u64 i = 0; i < times.size(); ++i)
    if (!(times[i] >= 0 && times[i] <= kLatest))
      return fail(Code::kInvalidArgument, place_of(i, width, "times"),
                  fmt::format("is {:g} s; give seconds after the shutter's opening, in [0, {:g}]",
                              times[i], kLatest));
  return {};
}

/// A distance and an angle.
struct Step {
  float metres = 0, radians = 0;
};
Step step_between(const TableRay& a, const TableRay& b) {
  const glm::dvec3 apart =
      glm::normalize(glm::dvec3(a.direction)) - glm::normalize(glm::dvec3(b.direction));
  return {glm::distance(a.origin, b.origin),
          float(2 * std::asin(std::min(1.0, 0.5 * glm::length(apart))))};
}

float median(std::vector<float>& values) {
  if (values.empty()) return INFINITY;
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The median step from a pixel to the one that is `right` and `down` of it; infinite where no two
/// see something.
Step median_step(std::span<const TableRay> rays, uvec2 size, u32 right, u32 down) {
  std::vector<float> metres, radians;
  for (u32 y = 0; y + down < size.y; ++y)
    for (u32 x = 0; x + right < size.x; ++x) {
      const TableRay& a = rays[u64(y) * size.x + x];
      const TableRay& b = rays[u64(y + down) * size.x + x + right];
      if (!sees(a) || !sees(b)) continue;
      const Step step = step_between(a, b);
      metres.push_back(step.metres);
      radians.push_back(step.radians);
    }
  return {median(metres), median(radians)};
}

/// The narrow side of what a pixel stands for: textures are never blurred too much.
Step footprint(std::span<const TableRay> rays, uvec2 size) {
  const Step across = median_step(rays, size, 1, 0), along = median_step(rays, size, 0, 1);
  const Step narrow{std::min(across.metres, along.metres), std::min(across.radians, along.radians)};
  return std::isfinite(narrow.radians) ? narrow : Step{};
}

void measure(RayTable& table, uvec2 size) {
  const Step pixel = footprint(table.rays.span(), size);
  table.view = {.rays = table.rays.data(),
                .times = table.times.data(),
                .interpolated = table.interpolated,
                .width = pixel.metres,
                .spread = pixel.radians};
  if (!table.times.empty()) table.last_time = double(std::ranges::max(table.times));
}

}  // namespace

Expected<std::shared_ptr<const RayTable>> to_ray_table(const v1::RayTable& message, uvec2 size,
                                                       ArraySource& source) {
  const Dim height{"height", size.y}, width{"width", size.x};
  auto table = std::make_shared<RayTable>();
  if (!message.has_rays())
    return fail(Code::kInvalidArgument, "rays",
                "is missing; give (height, width, 6): origin and direction of each pixel");
  HELIO_TAKE(table->rays, read_floats<TableRay>(message.rays(), source, {height, width, {"", 6}}),
             "rays");
  HELIO_TRY(check_rays(table->rays.span(), size.x));
  if (message.has_times()) {
    HELIO_TAKE(table->times, read_floats<float>(message.times(), source, {height, width}), "times");
    HELIO_TRY(check_times(table->times.span(), size.x));
  }
  table->interpolated = message.interpolated();
  measure(*table, size);
  return table;
}

v1::RayTable to_proto(const RayTable& table, uvec2 size, const ArraySink& sink) {
  v1::RayTable message;
  const std::array<u64, 3> shape{size.y, size.x, 6};
  *message.mutable_rays() = to_array(table.rays.buffer(), v1::D_TYPE_F32, shape, sink);
  if (!table.times.empty())
    *message.mutable_times() =
        to_array(table.times.buffer(), v1::D_TYPE_F32, std::span(shape).first(2), sink);
  if (table.interpolated) message.set_interpolated(true);
  return message;
}

}  // namespace heliograph::server
