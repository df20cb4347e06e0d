// Rays of a camera, and where it sees a point. Called by path.h and probe.h.
#pragma once

#include "kernels/camera/projection.h"
#include "kernels/camera/ray_table.h"
#include "kernels/core/warp.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// From the camera's OpenGL frame to its OpenCV frame (x right, y down, z forward), and back.
KERNEL vec3 cv_from_gl(vec3 v) { return vec3(v.x, -v.y, -v.z); }

/// Factor from metres of clipping to metres along a ray.
template <class F>
KERNEL F clip_scale(const CameraView& camera, Vec3<F> direction) {
  if (!is_straight(camera.lens.projection)) return 1;
  return 1 / dot(direction, Vec3<F>(normalize(-camera.world_from_camera[2])));
}

/// Distance of the near plane along a ray from the camera, metres.
KERNEL float near_of(const CameraView& camera, vec3 direction) {
  return camera.near > 0 ? camera.near * clip_scale(camera, direction) : 0;
}

/// The part of a ray that lies between the clipping planes: its end is <= 0 where there is none.
template <class F>
KERNEL void clip(const CameraView& camera, Vec3<F> direction, Vec3<F>& origin, F& end) {
  if (!(camera.near > 0) && !(camera.far > 0)) return;
  const F scale = clip_scale(camera, direction);
  if (camera.far > 0) end = min2(end, camera.far * scale);
  const F skipped = camera.near * scale;
  origin += direction * skipped;
  end -= skipped;
}
KERNEL Ray clipped(const CameraView& camera, Ray ray) {
  clip(camera, ray.direction, ray.origin, ray.t_max);
  return ray;
}

/// Raster position of the centre of pixel (x, y).
KERNEL vec2 centre_of(u32 x, u32 y) { return vec2(float(x) + 0.5f, float(y) + 0.5f); }

/// Place of a raster position on the lens model's image plane.
template <class F>
KERNEL Vec2<F> image_place(const CameraView& camera, Vec2<F> raster) {
  return Vec2<F>((raster.x - camera.cx) / camera.fx, (raster.y - camera.cy) / camera.fy);
}
/// The direction, in the world, of what is at d in front of the camera (OpenCV frame).
template <class F>
KERNEL Vec3<F> ray_direction(const CameraView& camera, Vec3<F> d) {
  return normalize(transform_vector(camera.world_from_camera, Vec3<F>(d.x, -d.y, -d.z)));
}

/// The ray that a table has there.
KERNEL Ray table_ray(const CameraView& camera, vec2 raster, HoleKey holes) {
  const TableRay ray = table_ray(camera.table, uvec2(camera.width, camera.height), raster);
  const bool seen = sees(ray);
  return {transform_point(camera.world_from_camera, cv_from_gl(ray.origin)),
          ray_direction(camera, seen ? ray.direction : vec3(0, 0, 1)), seen ? INFINITY : 0,
          camera.time, holes};
}

/// The ray through a raster position (pixel (x, y) covers [x, x + 1) x [y, y + 1)), neither blurred
/// nor clipped; t_max is 0 where the camera sees nothing.
KERNEL Ray pinhole_ray(const CameraView& camera, vec2 raster, HoleKey holes) {
  if (camera.table.rays) return table_ray(camera, raster, holes);
  const vec2 m = image_place(camera, raster);
  if (is_parallel(camera.lens.projection)) {
    return {transform_point(camera.world_from_camera, vec3(m.x, -m.y, 0)),
            normalize(-camera.world_from_camera[2]), INFINITY, camera.time, holes};
  }
  vec3 d(m, 1);
  const bool seen = is_rectilinear(camera.lens) || unproject(camera.lens, m, d);
  if (!seen) d = vec3(0, 0, 1);  // Newton's method may have left the numbers
  return {camera.world_from_camera[3], ray_direction(camera, d), seen ? INFINITY : 0, camera.time,
          holes};
}

/// The ray through a raster position between the clipping planes, without blur.
KERNEL Ray camera_ray(const CameraView& camera, vec2 raster, HoleKey holes) {
  return clipped(camera, pinhole_ray(camera, raster, holes));
}

/// How far beside a pixel's centre labels are taken, pixels: edges of regular scenes lie on rows of
/// centres exactly, where rounding would let a ray through between two triangles that share one.
KERNEL vec2 beside_centre(const CameraView& camera) {
  return vec2(0.83f, 0.57f) * (0x1p-21f * float(camera.width));
}

/// The ray that labels look along, by a pixel's centre.
KERNEL Ray centre_ray(const CameraView& camera, vec2 centre) {
  return camera_ray(camera, centre + beside_centre(camera), {0, true});
}

/// Its direction, unit, in double precision. That of a lens that bends rays is as the ray has it.
KERNEL glm::dvec3 centre_direction(const CameraView& camera, vec2 centre, const Ray& ray) {
  using glm::dvec3;
  const glm::dmat4x3 pose(camera.world_from_camera);
  if (is_parallel(camera.lens.projection)) return normalize(-pose[2]);
  if (!is_rectilinear(camera.lens)) return normalize(dvec3(ray.direction));
  const glm::dvec2 m =
      (glm::dvec2(centre + beside_centre(camera)) - glm::dvec2(camera.cx, camera.cy)) /
      glm::dvec2(camera.fx, camera.fy);
  return normalize(pose[0] * m.x - pose[1] * m.y - pose[2]);
}

/// A point of the aperture, uniform in its area; in units of its radius, x right and y up.
KERNEL vec2 sample_aperture(const ApertureView& aperture, vec2 u) {
  if (aperture.blades == 0) return sample_disk(u);
  const float place = u.x * float(aperture.blades);
  const float blade = min2(std::floor(place), float(aperture.blades - 1));
  const vec2 w = sample_triangle(vec2(place - blade, u.y));
  const SinCos a = sincos_turns(aperture.turn + blade / float(aperture.blades));
  const SinCos b = sincos_turns(aperture.turn + (blade + 1) / float(aperture.blades));
  return vec2(a.cos * w.x + b.cos * w.y, a.sin * w.x + b.sin * w.y);
}

/// A ray through a raster position by a thin lens: through a point of the aperture, and through the
/// point of the plane of focus that the pinhole's ray meets. Perspective and orthographic cameras.
///
/// Source: Potmesil and Chakravarty 1981, "A Lens and Aperture Camera Model for Synthetic Image
/// Generation"; Cook, Porter and Carpenter 1984, "Distributed Ray Tracing".
KERNEL Ray thin_lens_ray(const CameraView& camera, vec2 raster, vec2 u, HoleKey holes) {
  Ray ray = pinhole_ray(camera, raster, holes);
  const vec3 sharp =
      ray.origin + ray.direction * (camera.aperture.focus * clip_scale(camera, ray.direction));
  const vec2 lens = sample_aperture(camera.aperture, u) * camera.aperture.radius;
  ray.origin += camera.world_from_camera[0] * lens.x + camera.world_from_camera[1] * lens.y;
  ray.direction = normalize(sharp - ray.origin);
  return clipped(camera, ray);
}

/// Where a camera sees something.
struct Projected {
  vec2 raster;
  bool seen;  // otherwise raster means nothing
};

KERNEL Projected project_cv(const CameraView& camera, vec3 p_cv) {
  if (is_rectilinear(camera.lens)) {
    const float scale = is_parallel(camera.lens.projection) ? 1 : 1 / p_cv.z;
    return {vec2(camera.fx * p_cv.x * scale + camera.cx, camera.fy * p_cv.y * scale + camera.cy),
            p_cv.z > 0};
  }
  vec2 m(0);
  const bool seen = project(camera.lens, p_cv, m);
  return {vec2(camera.fx * m.x + camera.cx, camera.fy * m.y + camera.cy), seen};
}

/// A world vector in the camera's OpenCV frame.
KERNEL vec3 turn_to_camera(const CameraView& camera, vec3 v) {
  return cv_from_gl(transform_vector(camera.camera_from_world, v));
}

/// A world point in the camera's OpenCV frame. The camera's place is taken off first: far from the
/// origin of the world the two have but their last digits to differ in.
KERNEL vec3 point_in_camera(const CameraView& camera, vec3 p_world) {
  return turn_to_camera(camera, p_world - camera.world_from_camera[3]);
}

KERNEL Projected project(const CameraView& camera, vec3 p_world) {
  return project_cv(camera, point_in_camera(camera, p_world));
}

/// Where a point infinitely far along a direction is seen. A camera of parallel rays sees it only
/// straight ahead; there `otherwise` is returned.
KERNEL Projected project_direction(const CameraView& camera, vec3 direction, vec2 otherwise) {
  const vec3 d = turn_to_camera(camera, direction);
  if (!is_parallel(camera.lens.projection)) return project_cv(camera, d);
  return {otherwise, d.z > 0 && sqr(d.x) + sqr(d.y) < 1e-10f * sqr(d.z)};
}

/// The camera's ray that ends at a point that it sees; not clipped.
KERNEL Ray camera_ray_to(const CameraView& camera, vec3 p_world, HoleKey holes) {
  vec3 direction;
  if (is_parallel(camera.lens.projection)) {
    direction = normalize(-camera.world_from_camera[2]);
    const float distance = dot(p_world - camera.world_from_camera[3], direction);
    return {p_world - direction * distance, direction, distance, camera.time, holes};
  }
  direction = p_world - camera.world_from_camera[3];
  const float distance = length(direction);
  return {camera.world_from_camera[3], direction / distance, distance, camera.time, holes};
}

/// True if a point lies between the clipping planes.
KERNEL bool within_clip(const CameraView& camera, vec3 p_world) {
  if (!(camera.near > 0) && !(camera.far > 0)) return true;
  const Ray ray = camera_ray_to(camera, p_world, {0, true});
  const float place = ray.t_max / clip_scale(camera, ray.direction);
  return place >= camera.near && (!(camera.far > 0) || place <= camera.far);
}

KERNEL bool inside_image(const CameraView& camera, vec2 raster) {
  return raster.x >= 0 && raster.y >= 0 && raster.x < float(camera.width) &&
         raster.y < float(camera.height);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
