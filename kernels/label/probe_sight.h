// Along what a probe looks, what it meets there, and where that is in another frame. Called by
// probe.h.
#pragma once

#include "kernels/camera/rolling.h"
#include "kernels/geometry/exact.h"
#include "kernels/light/light.h"
#include "kernels/media/inside.h"
#include "kernels/media/volume_march.h"
#include "kernels/scene/film.h"
#include "kernels/scene/settings.h"

namespace heliograph::kernels {

/// A scene and the camera in it, over the times of the image's rows.
struct ProbeScene {
  const SceneView* scene;
  const CameraView* camera;
  bool camera_jumped = false;  // as an end of flow: no flow in pixels to there is valid
};

/// Inputs of a probe. forward, backward: the other ends of flow, null when not wanted; their
/// instances and triangles are those of `now`, in the same order, elsewhere.
struct ProbeContext {
  ProbeScene now;
  ProbeScene forward;
  ProbeScene backward;
  const CameraView* disparity;  // the second camera of a rectified rig, null when not wanted
  const Settings* settings;
  // Boxes of the instances, then of the volumes of `now`; null when no plane asks.
  const RestBoxView* rest_boxes;
};

}  // namespace heliograph::kernels

namespace heliograph::kernels::inline HELIO_ISA {

/// Glass that probes look through when Settings::through_transmission is set.
KERNEL bool is_clear(const MaterialValues& m) {
  return m.transmission >= 0.5f && m.metallic < 0.5f && m.roughness <= 0.2f;
}

/// A tracer and how many rays it has traced.
template <Tracer T>
struct CountedTracer {
  const T& tracer;
  u32& rays;
};

/// Ray that a probe looks along.
struct Sight {
  Ray ray;  // t_max 0: there is nothing to see
  u32 mask;
  float passed;          // metres, from where its distance counts to the ray's origin
  glm::dvec3 direction;  // the ray's
};

/// Sight of the label of a pixel, by its centre.
KERNEL Sight centre_sight(const CameraView& camera, vec2 centre) {
  const Ray ray = centre_ray(camera, centre);
  return {ray, kCameraRay, near_of(camera, ray.direction), centre_direction(camera, centre, ray)};
}

/// A hit with its distance and its place in the primitive as meet_exactly() has them.
KERNEL Hit refined(const SceneView& scene, const Ray& ray, glm::dvec3 direction, Hit hit) {
  ExactHit exact;
  if (hit.instance == kNone || !meet_exactly(scene, ray, direction, hit, exact)) return hit;
  hit.t = float(exact.t);
  const bool curve = scene.meshes[scene.instances[hit.instance].mesh].shape == Shape::kCurves;
  hit.u = curve ? float(exact.u) : clamp01(float(exact.u));
  hit.v = curve ? float(exact.v) : min2(max2(float(exact.v), 0.0f), 1 - hit.u);
  return hit;
}

/// The nearest surface that a probe takes, within ray.t_max. Layers of clear glass are looked
/// through in a straight line, so that the pixel sees what lies behind it in projection. What a
/// body of higher priority displaces is not there.
template <Tracer T>
KERNEL Hit probe_closest(const SceneView& scene, CountedTracer<T> counted, Ray ray,
                         bool through_transmission, u32 mask = kCameraRay) {
  Inside inside;
  if (scene.any_priority) inside = inside_at(scene, counted.tracer, ray, counted.rays);
  const vec3 start = ray.origin;
  for (u32 layer = 0;; ++layer) {
    Hit hit = counted.tracer.closest(ray, mask);
    hit.t += dot(ray.origin - start, ray.direction);
    ++counted.rays;
    const bool takes_all = !through_transmission && inside.depth == 0;
    if (hit.instance == kNone || takes_all || layer == 1024) return hit;
    const Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
    const MaterialValues m = material_at(scene, s, ~0u);
    const Meeting meeting = boundary_at(scene, inside, s, ray.direction).meeting;
    if (meeting != Meeting::kAbsent && !(through_transmission && is_clear(m))) return hit;
    if (scene.any_priority) cross_surface(inside, s, m, ray.direction);
    const vec3 next = offset_point(s, ray.direction);
    ray.t_max -= dot(next - ray.origin, ray.direction);
    ray.origin = next;
    if (!(ray.t_max > 0)) return {INFINITY, kNone, 0, 0, 0};
  }
}

/// True if a camera sees a point of a surface: nothing lies before it.
template <Tracer T>
KERNEL bool camera_sees(const ProbeScene& at, CountedTracer<T> counted, const Surface& s,
                        bool through_transmission) {
  if (!within_clip(*at.camera, s.p)) return false;
  const vec3 towards = camera_ray_to(*at.camera, s.p, {0, true}).direction;
  Ray ray = camera_ray_to(*at.camera, offset_point(s, -towards), {0, true});
  ray.t_max *= kJustBefore;
  ray = clipped(*at.camera, ray);
  return !(ray.t_max > 0) ||
         probe_closest(*at.scene, counted, ray, through_transmission).instance == kNone;
}

/// True if a camera sees a point of a volume: no surface lies before it.
template <Tracer T>
KERNEL bool camera_sees(const ProbeScene& at, CountedTracer<T> counted, vec3 p_world,
                        bool through_transmission) {
  if (!within_clip(*at.camera, p_world)) return false;
  const Ray ray = clipped(*at.camera, camera_ray_to(*at.camera, p_world, {0, true}));
  return !(ray.t_max > 0) ||
         probe_closest(*at.scene, counted, ray, through_transmission).instance == kNone;
}

struct Flow {
  vec2 pixels;
  u8 valid;
  u8 visible;
  vec3 metres;
};

KERNEL vec3 point_of(const Surface& s) { return s.p; }
KERNEL vec3 point_of(vec3 p) { return p; }

/// Where the probed point is in another frame. In space that is a frame_interval from the probe; in
/// pixels, when the other frame's row sees it.
///
/// at    (time) -> the point there, of a surface or of a volume
template <Tracer T, class At>
KERNEL Flow flow_of(const ProbeContext& context, const ProbeScene& other, CountedTracer<T> counted,
                    vec3 p_world, const At& at) {
  Flow flow{vec2(0), 0, 0, point_of(at(context.now.camera->time)) - p_world};
  if (other.camera_jumped) return flow;
  const vec2 from = project(*context.now.camera, p_world).raster;
  const Sighting to = find_row(*other.camera, from.y, [&](const CameraView& camera) {
    return project(camera, point_of(at(camera.time)));
  });
  if (!to.found || !to.at.seen) return flow;
  flow.pixels = to.at.raster - from;
  flow.valid = 1;
  const CameraAt camera(*other.camera, to.time);
  flow.visible = inside_image(*other.camera, to.at.raster) &&
                 camera_sees({other.scene, &camera.camera()}, counted, at(to.time),
                             context.settings->through_transmission);
  return flow;
}

/// Flow of the point of a surface where a probe's ray met it. It moves as the point does that its
/// place in the triangle names, which rounding may have put beside the ray.
template <Tracer T>
KERNEL Flow flow_to(const ProbeContext& context, const ProbeScene& other, CountedTracer<T> counted,
                    const Hit& hit, vec3 p_world) {
  if (other.scene->instances[hit.instance].flags & kFlowInvalid) return {vec2(0), 0, 0, vec3(0)};
  const auto place_in = [&hit](const SceneView& scene, float time) {
    return locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), time);
  };
  const vec3 beside = p_world - place_in(*context.now.scene, context.now.camera->time).p;
  return flow_of(context, other, counted, p_world, [&](float time) {
    Surface there = place_in(*other.scene, time);
    there.p += beside;
    return there;
  });
}

/// Flow of a point infinitely far away: the camera's rotation alone.
KERNEL Flow background_flow(const ProbeContext& context, const ProbeScene& other, const Ray& ray,
                            vec2 raster) {
  Flow flow{vec2(0), 0, 0, vec3(0)};
  if (other.camera_jumped) return flow;
  const Projected from = project_direction(*context.now.camera, ray.direction, raster);
  const Sighting to = find_row(*other.camera, raster.y, [&](const CameraView& camera) {
    return project_direction(camera, ray.direction, raster);
  });
  if (!to.found || !to.at.seen) return flow;
  flow.pixels = to.at.raster - from.raster;
  flow.valid = 1;
  return flow;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
