// The inputs of post planes, and the planes of a film that follow from them.
#include "renderer/frame/film_planes.h"

#include <algorithm>
#include <array>
#include <span>

namespace heliograph {
namespace {

using kernels::Fold;

constexpr std::array kDenoiserInputs{Plane::BEAUTY, Plane::ALBEDO_MEAN, Plane::NORMAL_MEAN};

constexpr std::array kRgbSensorInputs{Plane::BEAUTY};
constexpr std::array kDepthSensorInputs{Plane::DEPTH,       Plane::DISTANCE,  Plane::NORMAL_CAMERA,
                                        Plane::BASE_COLOR,  Plane::ROUGHNESS, Plane::METALLIC,
                                        Plane::TRANSMISSION};

/// Inputs of a post plane.
std::span<const Plane> inputs_of(Plane plane) {
  if (plane == Plane::DENOISED) return kDenoiserInputs;
  if (plane == Plane::SENSOR_RGB || plane == Plane::SENSOR_MOSAIC) return kRgbSensorInputs;
  if (plane == Plane::SENSOR_DEPTH) return kDepthSensorInputs;
  return {};
}

}  // namespace

bool wants_post(const RenderJob& job) {
  return std::ranges::any_of(job.planes,
                             [](Plane plane) { return plane_info(plane).fold == Fold::kPost; });
}

std::vector<Plane> film_planes(const RenderJob& job) {
  std::vector<Plane> planes;
  for (const Plane plane : job.planes)
    if (plane_info(plane).fold != Fold::kPost) planes.push_back(plane);
  for (const Plane plane : job.planes)
    for (const Plane input : inputs_of(plane))
      if (std::ranges::count(planes, input) == 0) planes.push_back(input);
  return planes;
}

bool is_read_beside(const RenderJob& job, Plane film_plane) {
  if (std::ranges::count(job.planes, film_plane) > 0) return true;
  return std::ranges::any_of(job.planes, [&](Plane plane) {
    return plane != Plane::DENOISED && std::ranges::count(inputs_of(plane), film_plane) > 0;
  });
}

}  // namespace heliograph
