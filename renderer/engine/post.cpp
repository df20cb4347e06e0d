// What each post plane needs, and how it is made.
#include "renderer/engine/post.h"

#include <algorithm>
#include <array>
#include <span>

#include "kernels/core/hash.h"
#include "renderer/engine/sensor.h"

namespace heliograph {
namespace {

using kernels::Fold;

constexpr std::array kDenoiserInputs{Plane::BEAUTY, Plane::ALBEDO_MEAN, Plane::NORMAL_MEAN};

constexpr std::array kRgbSensorInputs{Plane::BEAUTY};
constexpr std::array kDepthSensorInputs{Plane::DEPTH,      Plane::NORMAL_CAMERA,
                                        Plane::BASE_COLOR, Plane::ROUGHNESS,
                                        Plane::METALLIC,   Plane::TRANSMISSION};

/// What a post plane is computed from.
std::span<const Plane> inputs_of(Plane plane) {
  if (plane == Plane::DENOISED) return kDenoiserInputs;
  if (plane == Plane::SENSOR_RGB || plane == Plane::SENSOR_MOSAIC) return kRgbSensorInputs;
  if (plane == Plane::SENSOR_DEPTH) return kDepthSensorInputs;
  return {};
}

PlaneData& find(std::vector<PlaneData>& planes, Plane plane) {
  return *std::ranges::find(planes, plane, &PlaneData::plane);
}

/// Fills a post plane from those that are made.
Status fill(Plane plane, std::vector<PlaneData>& made, const PostContext& context, float* out) {
  const auto floats = [&](Plane input) {
    return reinterpret_cast<const float*>(find(made, input).pixels.data());
  };
  const SensorContext sensor{context.camera, context.sensor_seed, context.interrupt};
  if (plane == Plane::SENSOR_RGB)
    return sense_rgb(*context.model.rgb_sensor, {floats(Plane::BEAUTY)}, sensor, out);
  if (plane == Plane::SENSOR_MOSAIC)
    return sense_mosaic(*context.model.rgb_sensor, {floats(Plane::BEAUTY)}, sensor, out);
  if (plane == Plane::SENSOR_DEPTH)
    return sense_depth(*context.model.depth_sensor,
                       {.depth = floats(Plane::DEPTH),
                        .normal_camera = floats(Plane::NORMAL_CAMERA),
                        .base_color = floats(Plane::BASE_COLOR),
                        .roughness = floats(Plane::ROUGHNESS),
                        .metallic = floats(Plane::METALLIC),
                        .transmission = floats(Plane::TRANSMISSION)},
                       sensor, out);
  return context.denoiser.denoise({.width = context.camera.width,
                                   .height = context.camera.height,
                                   .beauty = floats(Plane::BEAUTY),
                                   .albedo = floats(Plane::ALBEDO_MEAN),
                                   .normal = floats(Plane::NORMAL_MEAN),
                                   .out = out},
                                  context.interrupt);
}

}  // namespace

u64 sensor_seed(const RenderJob& job, EntityId camera) {
  u64 seed = kernels::hash64(job.settings.seed);
  for (const char c : job.snapshot->name_of(camera)) seed = kernels::hash64(seed + u8(c));
  return seed;
}

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

Expected<std::vector<PlaneData>> finish_planes(const RenderJob& job, std::vector<PlaneData> made,
                                               const PostContext& context) {
  for (const Plane plane : job.planes) {
    if (plane_info(plane).fold != Fold::kPost) continue;
    if (std::ranges::count(made, plane, &PlaneData::plane) > 0) {  // on the device
      HELIO_TRY(context.interrupt.status());
      continue;
    }
    const u64 pixels = u64(context.camera.width) * context.camera.height;
    PlaneData out = new_plane(job, plane, pixels);
    HELIO_TRY(fill(plane, made, context, reinterpret_cast<float*>(out.pixels.data())));
    made.push_back(std::move(out));
  }
  std::vector<PlaneData> planes;
  for (const Plane plane : job.planes) {
    PlaneData& next = find(made, plane);
    planes.push_back({plane, std::move(next.pixels)});
    next.plane = Plane::kCount;  // taken: light groups have a plane each
  }
  return planes;
}

}  // namespace heliograph
