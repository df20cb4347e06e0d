// What each post plane needs, and how it is made.
#include "renderer/engine/post.h"

#include <algorithm>
#include <array>
#include <span>

namespace heliograph {
namespace {

using kernels::Fold;

constexpr std::array kDenoiserInputs{Plane::BEAUTY, Plane::ALBEDO_MEAN, Plane::NORMAL_MEAN};

/// What a post plane is computed from.
std::span<const Plane> inputs_of(Plane plane) {
  if (plane == Plane::DENOISED) return kDenoiserInputs;
  return {};
}

PlaneData& find(std::vector<PlaneData>& planes, Plane plane) {
  return *std::ranges::find(planes, plane, &PlaneData::plane);
}

Expected<PlaneData> denoised(std::vector<PlaneData>& made, const PostContext& context) {
  const auto floats = [&](Plane plane) {
    return reinterpret_cast<const float*>(find(made, plane).pixels.data());
  };
  PlaneData out{Plane::DENOISED, std::vector<std::byte>(find(made, Plane::BEAUTY).pixels.size())};
  HELIO_TRY(context.denoiser.denoise({.width = context.width,
                                      .height = context.height,
                                      .beauty = floats(Plane::BEAUTY),
                                      .albedo = floats(Plane::ALBEDO_MEAN),
                                      .normal = floats(Plane::NORMAL_MEAN),
                                      .out = reinterpret_cast<float*>(out.pixels.data())},
                                     context.interrupt));
  return out;
}

}  // namespace

std::vector<Plane> film_planes(const RenderJob& job) {
  std::vector<Plane> planes;
  for (const Plane plane : job.planes)
    if (plane_info(plane).fold != Fold::kPost) planes.push_back(plane);
  for (const Plane plane : job.planes)
    for (const Plane input : inputs_of(plane))
      if (std::ranges::count(planes, input) == 0) planes.push_back(input);
  return planes;
}

Expected<std::vector<PlaneData>> finish_planes(const RenderJob& job, std::vector<PlaneData> made,
                                               const PostContext& context) {
  for (const Plane plane : job.planes) {
    if (plane != Plane::DENOISED) continue;
    auto out = denoised(made, context);
    if (!out) return std::unexpected(std::move(out).error());
    made.push_back(*std::move(out));
  }
  std::vector<PlaneData> planes;
  for (const Plane plane : job.planes) {
    PlaneData& next = find(made, plane);
    planes.push_back(std::move(next));
    next.plane = Plane::kCount;  // taken: light groups have a plane each
  }
  return planes;
}

}  // namespace heliograph
