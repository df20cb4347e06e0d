// A camera's rays as an object sees them. Called by silhouettes.cpp.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/camera/camera.h"
#include "renderer/base/types.h"
#include "renderer/host/ray_packet.h"

namespace heliograph::host {

inline constexpr kernels::HoleKey kProbe{0, true};

/// Distances of what 8 pixels show, metres along their rays.
using Distances = std::array<float, RayPacket::kRays>;

/// A camera's rays through pixel centres in the space of one object, not normalised. Those of a
/// camera that sees straight lines straight are affine in the pixel. The camera stands still.
class ObjectRays {
 public:
  ObjectRays(const kernels::CameraView& camera, const mat4x3& object_from_world)
      : camera_(&camera),
        object_from_world_(object_from_world),
        straight_(kernels::is_rectilinear(camera.lens)) {
    const mat4x3 object_from_camera = multiply(object_from_world_, camera.world_from_camera);
    const mat3 linear(object_from_camera);
    const vec3 along_x = linear[0] / camera.fx, along_y = -linear[1] / camera.fy;
    const vec2 centre = kernels::beside_centre(camera) + 0.5f;
    const vec3 corner = along_x * (centre.x - camera.cx) + along_y * (centre.y - camera.cy);
    const bool perspective = !kernels::is_parallel(camera.lens.projection);
    beside_ = centre - vec2(camera.cx, camera.cy);
    widens_ = straight_ && perspective;
    direction_ = -linear[2] + (perspective ? corner : vec3(0));
    origin_ = object_from_camera[3] + (perspective ? vec3(0) : corner);
    (perspective ? direction_x_ : origin_x_) = along_x;
    (perspective ? direction_y_ : origin_y_) = along_y;
    if (camera.far > 0) t_max_ = camera.far - camera.near;
  }
  /// t_max is 0 where the camera sees nothing.
  [[nodiscard]] kernels::Ray through(float x, float y) const {
    if (!straight_) {
      kernels::Ray ray = kernels::centre_ray(*camera_, vec2(x, y) + 0.5f);
      ray.origin = kernels::transform_point(object_from_world_, ray.origin);
      ray.direction = kernels::transform_vector(object_from_world_, ray.direction);
      return ray;
    }
    const vec3 direction = direction_ + direction_x_ * x + direction_y_ * y;
    return {origin_ + origin_x_ * x + origin_y_ * y + direction * camera_->near, direction, t_max_,
            camera_->time, kProbe};
  }
  /// The rays through (x, y) ... (x + 7, y), behind what is so far away. Returns a bit for each
  /// where there is one.
  u32 through(float x, float y, const Distances& distances, RayPacket& rays) const {
    const Distances hiding = along(x, y, distances);
    u32 lanes = 0;
    for (u32 i = 0; i < RayPacket::kRays; ++i) {
      const kernels::Ray ray = through(x + float(i), y);
      rays.t_min[i] = std::max(hiding[i], 0.0f);
      lanes |= u32(ray.t_max > rays.t_min[i]) << i;
      rays.origin_x[i] = ray.origin.x;
      rays.origin_y[i] = ray.origin.y;
      rays.origin_z[i] = ray.origin.z;
      rays.direction_x[i] = ray.direction.x;
      rays.direction_y[i] = ray.direction.y;
      rays.direction_z[i] = ray.direction.z;
      rays.t_max[i] = ray.t_max;
    }
    rays.time = camera_->time;
    return lanes;
  }

 private:
  /// Distances from the camera by unit of the rays' directions, from where the rays start. What
  /// lies on the surface that is seen is behind it, within single precision.
  [[nodiscard]] Distances along(float x, float y, const Distances& distances) const {
    constexpr float kOn = 1 - 0x1p-14f;
    const float length_y2 = 1 + kernels::sqr((y + beside_.y) / camera_->fy);
    Distances out;
    for (u32 i = 0; i < RayPacket::kRays; ++i) {
      const float place_x = (x + float(i) + beside_.x) / camera_->fx;
      const float length = std::sqrt(length_y2 + place_x * place_x);
      out[i] = kOn * distances[i] / (widens_ ? length : 1) - camera_->near;
    }
    return out;
  }
  const kernels::CameraView* camera_;
  mat4x3 object_from_world_;
  bool straight_;
  bool widens_;  // its directions are longer towards the image's edge
  vec2 beside_;  // the raster place of pixel (0, 0), from the principal point
  float t_max_ = INFINITY;
  vec3 origin_, origin_x_{0}, origin_y_{0};
  vec3 direction_, direction_x_{0}, direction_y_{0};
};

}  // namespace heliograph::host
