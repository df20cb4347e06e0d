#include "renderer/post/post.h"

#include <algorithm>

#include "kernels/core/hash.h"
#include "renderer/post/sensor.h"

namespace heliograph {
namespace {

using kernels::Fold;

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
                        .distance = floats(Plane::DISTANCE),
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
