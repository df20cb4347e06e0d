// Where moving things are while the shutter is open: the keys that ray tracers interpolate too.
// Called by surface.h, light.h, path.h and probe.h; times are those of Ray::time.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Between keys `index` and `index` + 1, at fraction u.
struct Segment {
  u32 index;
  float u;
};
KERNEL Segment segment_at(u32 segments, float time) {
  const float x = clamp01(time) * float(segments);
  const u32 index = min2(u32(x), segments - 1);
  return {index, x - float(index)};
}

/// Slerp of unit quaternions less than 180 degrees of rotation apart; normalised lerp below 3.6
/// degrees, where it is the same within 1e-6 and where slerp loses digits.
///
/// Source: Shoemake 1985, "Animating Rotation with Quaternion Curves", section 3.3.
KERNEL vec4 interpolate_rotation(vec4 a, vec4 b, float u) {
  float cosine = dot(a, b);
  if (cosine < 0) {
    b = -b;
    cosine = -cosine;
  }
  if (cosine > 0.9995f) return normalize(a * (1 - u) + b * u);
  const vec4 across = b - a * cosine;
  const float sine = length(across);
  const SinCos turn = sincos_turns(u * atan2_turns(sine, cosine));
  return a * turn.cos + across * (turn.sin / sine);
}

KERNEL mat4x3 matrix_of(vec3 translation, vec4 q, const float (&shear)[6]) {
  const vec3 r0(1 - 2 * (q.y * q.y + q.z * q.z), 2 * (q.x * q.y + q.z * q.w),
                2 * (q.x * q.z - q.y * q.w));
  const vec3 r1(2 * (q.x * q.y - q.z * q.w), 1 - 2 * (q.x * q.x + q.z * q.z),
                2 * (q.y * q.z + q.x * q.w));
  const vec3 r2(2 * (q.x * q.z + q.y * q.w), 2 * (q.y * q.z - q.x * q.w),
                1 - 2 * (q.x * q.x + q.y * q.y));
  return mat4x3(r0 * shear[0], r0 * shear[1] + r1 * shear[3],
                r0 * shear[2] + r1 * shear[4] + r2 * shear[5], translation);
}

/// The pose between two neighbouring keys.
KERNEL mat4x3 interpolate(const MotionKey& a, const MotionKey& b, float u) {
  const auto mix = [u](float x, float y) { return x * (1 - u) + y * u; };
  const float shear[6] = {mix(a.xx, b.xx), mix(a.xy, b.xy), mix(a.xz, b.xz),
                          mix(a.yy, b.yy), mix(a.yz, b.yz), mix(a.zz, b.zz)};
  return matrix_of(a.translation * (1 - u) + b.translation * u,
                   interpolate_rotation(a.rotation, b.rotation, u), shear);
}

KERNEL mat4x3 inverse_of(const mat4x3& m) {
  const mat3 linear = glm::inverse(mat3(m[0], m[1], m[2]));
  return mat4x3(linear[0], linear[1], linear[2], -(linear * m[3]));
}

/// The pose of an instance at one time.
template <class F>
struct ObjectPoseOf {
  Mat4x3<F> world_from_object;
  Mat4x3<F> object_from_world;
};
using ObjectPose = ObjectPoseOf<float>;
KERNEL ObjectPose pose_at(const SceneView& scene, const InstanceView& instance, float time) {
  if (instance.segments == 0) return {instance.world_from_object, instance.object_from_world};
  const Segment s = segment_at(instance.segments, time);
  const MotionKey* key = scene.motion_keys + instance.first_key + s.index;
  const mat4x3 world = interpolate(key[0], key[1], s.u);
  return {world, inverse_of(world)};
}

/// A camera as it is at one time; its rays are of that time.
KERNEL CameraView camera_at(const CameraView& camera, float time) {
  CameraView now = camera;
  now.time = time;
  if (camera.segments == 0) return now;
  const Segment s = segment_at(camera.segments, time);
  const MotionKey* key = camera.motion_keys + s.index;
  now.world_from_camera = interpolate(key[0], key[1], s.u);
  now.camera_from_world = inverse_of(now.world_from_camera);
  now.segments = 0;
  return now;
}

/// A camera at one time, without a copy where it stands still at time 0.
class CameraAt {
 public:
  KERNEL CameraAt(const CameraView& camera, float time)
      : camera_(&camera), changed_(camera.segments > 0 || time != camera.time) {
    if (changed_) now_ = camera_at(camera, time);
  }
  KERNEL const CameraView& camera() const { return changed_ ? now_ : *camera_; }

 private:
  const CameraView* camera_;
  bool changed_;
  CameraView now_;
};

}  // namespace heliograph::kernels::inline HELIO_ISA
