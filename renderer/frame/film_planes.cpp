// The inputs of post planes, and the planes of a film that follow from them.
#include "renderer/frame/film_planes.h"

#include <algorithm>
#include <array>

namespace heliograph {
namespace {

using kernels::Fold;
using kernels::plane_bit;

constexpr std::array kInputsOf{
#define HELIO_PLANE(NAME, type, channels, fold, unit, part, ...) kernels::kInputs<kernels::part>,
    HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
};

bool has(PlaneSet planes, Plane plane) { return (planes & plane_bit(plane)) != 0; }

/// The plane, and what it is computed from.
PlaneSet with_inputs(Plane plane) { return plane_bit(plane) | kInputsOf[u32(plane)]; }

}  // namespace

bool is_averaged(Plane plane) { return (with_inputs(plane) & kSampledPlanes) != 0; }

PlaneSet wanted_planes(const RenderJob& job) {
  PlaneSet planes = 0;
  for (const Plane plane : job.planes) planes |= with_inputs(plane);
  return planes;
}

bool wants_post(const RenderJob& job) {
  return (wanted_planes(job) & kernels::planes_of(Fold::kPost)) != 0;
}

std::vector<Plane> film_planes(const RenderJob& job) {
  std::vector<Plane> planes;
  for (const Plane plane : job.planes)
    if (plane_info(plane).fold != Fold::kPost) planes.push_back(plane);
  const PlaneSet wanted = wanted_planes(job) & ~kernels::planes_of(Fold::kPost);
  for (u32 i = 0; i < kernels::kPlanes; ++i)
    if (has(wanted, Plane(i)) && std::ranges::count(planes, Plane(i)) == 0)
      planes.push_back(Plane(i));
  return planes;
}

bool is_read_beside(const RenderJob& job, Plane film_plane) {
  return std::ranges::any_of(job.planes, [&](Plane plane) {
    return plane == film_plane || (plane != Plane::DENOISED && has(with_inputs(plane), film_plane));
  });
}

}  // namespace heliograph
