// Labels: what the ray through a pixel's centre meets, exactly and without noise. probe_pixel() is
// the entry point of every backend.
#pragma once

#include "kernels/film.h"
#include "kernels/inside.h"
#include "kernels/light.h"
#include "kernels/rolling.h"
#include "kernels/settings.h"
#include "kernels/volume_march.h"

namespace heliograph::kernels {

/// A scene and the camera in it, over the times of the image's rows.
struct ProbeScene {
  const SceneView* scene;
  const CameraView* camera;
  bool camera_jumped = false;  // as an end of flow: no flow in pixels to there is valid
};

/// What a probe reads. forward, backward: the other ends of flow, null when not wanted; their
/// instances and triangles are those of `now`, in the same order, elsewhere.
struct ProbeContext {
  ProbeScene now;
  ProbeScene forward;
  ProbeScene backward;
  const CameraView* disparity;  // the second camera of a rectified rig, null when not wanted
  const Settings* settings;
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

/// The nearest surface that a probe takes, within ray.t_max. Layers of clear glass are looked
/// through in a straight line, so that the pixel sees what lies behind it in projection. What a
/// body of higher priority displaces is not there.
template <Tracer T>
KERNEL Hit probe_closest(const SceneView& scene, CountedTracer<T> counted, Ray ray,
                         bool through_transmission) {
  Inside inside;
  if (scene.any_priority) inside = inside_at(scene, counted.tracer, ray, counted.rays);
  for (u32 layer = 0;; ++layer) {
    const Hit hit = counted.tracer.closest(ray, kCameraRay);
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

/// Whether a camera sees a point of a surface: nothing lies before it.
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

/// Whether a camera sees a point of a volume: no surface lies before it.
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

/// Flow of a point of a surface.
template <Tracer T>
KERNEL Flow flow_to(const ProbeContext& context, const ProbeScene& other, CountedTracer<T> counted,
                    const Hit& hit, vec3 p_world) {
  if (other.scene->instances[hit.instance].flags & kFlowInvalid) return {vec2(0), 0, 0, vec3(0)};
  return flow_of(context, other, counted, p_world, [&](float time) {
    return locate(*other.scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), time);
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

KERNEL void put_flow(Probe& p, const Flow& flow, bool forward) {
  (forward ? p.flow_forward : p.flow_backward) = flow.pixels;
  (forward ? p.flow_forward_valid : p.flow_backward_valid) = flow.valid;
  (forward ? p.flow_forward_visible : p.flow_backward_visible) = flow.visible;
  if (forward) p.scene_flow = flow.metres;
}

/// What a probe says where it meets nothing.
KERNEL Probe empty_probe() {
  Probe p{};
  p.p_world = p.p_camera = p.object_coordinates = p.nocs = vec3(NAN);
  p.material_id = p.primitive = kNone;
  p.distance = INFINITY;
  return p;
}

inline constexpr PlaneSet kNormalPlanes =
    plane_bit(Plane::NORMAL) | plane_bit(Plane::NORMAL_CAMERA) | plane_bit(Plane::TANGENT);
inline constexpr PlaneSet kMaterialPlanes =
    plane_bit(Plane::BASE_COLOR) | plane_bit(Plane::ROUGHNESS) | plane_bit(Plane::METALLIC) |
    plane_bit(Plane::TRANSMISSION) | plane_bit(Plane::EMISSION);
inline constexpr PlaneSet kRestPlanes =
    plane_bit(Plane::OBJECT_COORDINATES) | plane_bit(Plane::NOCS);
inline constexpr PlaneSet kForwardPlanes =
    plane_bit(Plane::FLOW_FORWARD) | plane_bit(Plane::FLOW_FORWARD_VALID) |
    plane_bit(Plane::FLOW_FORWARD_VISIBLE) | plane_bit(Plane::SCENE_FLOW);
inline constexpr PlaneSet kBackwardPlanes = plane_bit(Plane::FLOW_BACKWARD) |
                                            plane_bit(Plane::FLOW_BACKWARD_VALID) |
                                            plane_bit(Plane::FLOW_BACKWARD_VISIBLE);
inline constexpr PlaneSet kDisparityPlanes =
    plane_bit(Plane::DISPARITY) | plane_bit(Plane::DISPARITY_VISIBLE);

KERNEL void probe_geometry(Probe& p, const Surface& s, const CameraView& camera, const Ray& ray) {
  p.distance = dot(s.p - ray.origin, ray.direction) + near_of(camera, ray.direction);
  p.p_world = s.p;
  p.p_camera = cv_from_gl(transform_point(camera.camera_from_world, s.p));
  p.geometric_normal = dot(s.ng, ray.direction) > 0 ? -s.ng : s.ng;
  p.barycentric = s.barycentric;
}

KERNEL void probe_shading(Probe& p, const Surface& s, const CameraView& camera, const Ray& ray) {
  p.normal = dot(s.ng, ray.direction) > 0 ? -s.ns : s.ns;
  p.normal_camera = normalize(cv_from_gl(transform_vector(camera.camera_from_world, p.normal)));
  const Corners c = corners_at(*s.mesh, s.triangle, s.time);
  p.tangent = world_tangent(s, s.ns, tangents_of(s, c, 0).t);
}

KERNEL void probe_labels(Probe& p, const Surface& s, const Hit& hit) {
  const InstanceView& instance = *s.instance;
  p.instance_label = instance.label;
  p.category = instance.category;
  const u32 further = instance.flags & kOnePart ? 0 : s.part;
  p.part = instance.label != 0 ? instance.part + further : 0;
  p.material_id = s.material->id;
  p.primitive = hit.primitive;
}

KERNEL void probe_rest(Probe& p, const Surface& s) {
  const vec3* rest = s.mesh->rest_positions ? s.mesh->rest_positions : s.mesh->positions;
  p.object_coordinates =
      transform_point(s.instance->box_from_object, interpolate(rest, s.triangle, s.barycentric));
  p.nocs = vec3(0.5f) + (p.object_coordinates - vec3(0.5f)) * s.instance->nocs_scale;
}

/// What the wanted planes say of the surface itself.
KERNEL void probe_surface(Probe& p, const ProbeScene& now, const Hit& hit, const Ray& ray,
                          PlaneSet wanted) {
  const SceneView& scene = *now.scene;
  Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
  p.hit = true;
  probe_geometry(p, s, *now.camera, ray);
  probe_labels(p, s, hit);
  if (wanted & kNormalPlanes) {
    s.ns = shading_normal(scene, s);
    probe_shading(p, s, *now.camera, ray);
  }
  if (wanted & plane_bit(Plane::UV)) p.uv = uvs_at(s).set[0];
  if (wanted & kMaterialPlanes) {
    p.material = material_at(scene, s, ~kAlphaBit);
    p.emission = emitted(scene, s, p.material, -ray.direction) + shown(s, p.material);
  }
  if (wanted & plane_bit(Plane::OPACITY)) {
    p.material.alpha = opacity_at(scene, hit.instance, hit.primitive, s.barycentric);
  }
  if (wanted & kRestPlanes) probe_rest(p, s);
}

/// What the planes say of the point where a volume's transmittance is one half. It has no normal
/// and no material.
KERNEL void probe_volume(Probe& p, const ProbeScene& now, const Collision& at, const Ray& ray) {
  const InstanceView& instance = now.scene->volumes[at.volume].instance;
  p.hit = true;
  p.distance = at.t + near_of(*now.camera, ray.direction);
  p.p_world = ray.origin + ray.direction * at.t;
  p.p_camera = cv_from_gl(transform_point(now.camera->camera_from_world, p.p_world));
  p.instance_label = instance.label;
  p.category = instance.category;
  p.part = instance.label != 0 ? instance.part : 0;
  const mat4x3 object_from_world = pose_at(*now.scene, instance, ray.time).object_from_world;
  p.object_coordinates =
      transform_point(instance.box_from_object, transform_point(object_from_world, p.p_world));
  p.nocs = vec3(0.5f) + (p.object_coordinates - vec3(0.5f)) * instance.nocs_scale;
}

/// Flow of that point, which moves with its entity. It is visible where no surface hides it.
template <Tracer T>
KERNEL Flow volume_flow(const ProbeContext& context, const ProbeScene& other,
                        CountedTracer<T> counted, u32 volume, vec3 p_world) {
  const InstanceView& then = other.scene->volumes[volume].instance;
  if (then.flags & kFlowInvalid) return {vec2(0), 0, 0, vec3(0)};
  const InstanceView& instance = context.now.scene->volumes[volume].instance;
  const mat4x3 object_from_world =
      pose_at(*context.now.scene, instance, context.now.camera->time).object_from_world;
  const vec3 p_object = transform_point(object_from_world, p_world);
  return flow_of(context, other, counted, p_world, [&](float time) {
    return transform_point(pose_at(*other.scene, then, time).world_from_object, p_object);
  });
}

/// The volume that owns a pixel whose centre ray meets a surface or nothing; kNone: none does.
KERNEL Collision probed_volume(const SceneView& scene, const Ray& ray, const Hit& hit) {
  if (scene.volume_count == 0) return {kNone, INFINITY};
  float t_max = ray.t_max;
  if (hit.instance != kNone) {
    const Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
    t_max = dot(s.p - ray.origin, ray.direction);
  }
  return half_way(scene, ray, t_max);
}

template <Tracer T>
KERNEL Probe probe_in_volume(const ProbeContext& context, const T* const (&tracers)[3],
                             const Collision& at, const Ray& ray, u32& rays) {
  Probe p = empty_probe();
  probe_volume(p, context.now, at, ray);
  if (context.forward.scene) {
    const CountedTracer<T> counted{*tracers[1], rays};
    put_flow(p, volume_flow(context, context.forward, counted, at.volume, p.p_world), true);
  }
  if (context.backward.scene) {
    const CountedTracer<T> counted{*tracers[2], rays};
    put_flow(p, volume_flow(context, context.backward, counted, at.volume, p.p_world), false);
  }
  if (context.disparity) {
    const CameraView& camera = *context.disparity;
    const Projected to = project(camera, p.p_world);
    if (!to.seen) return p;
    p.disparity = project(*context.now.camera, p.p_world).raster.x - to.raster.x;
    p.disparity_visible =
        inside_image(camera, to.raster) &&
        camera_sees({context.now.scene, &camera}, CountedTracer<T>{*tracers[0], rays}, p.p_world,
                    context.settings->through_transmission);
  }
  return p;
}

template <Tracer T>
KERNEL void probe_disparity(Probe& p, const ProbeContext& context, CountedTracer<T> counted,
                            const Surface& s) {
  const CameraAt second(*context.disparity, s.time);
  const CameraView& camera = second.camera();
  const Projected to = project(camera, s.p);
  if (!to.seen) return;
  p.disparity = project(*context.now.camera, s.p).raster.x - to.raster.x;
  p.disparity_visible =
      inside_image(camera, to.raster) &&
      camera_sees({context.now.scene, &camera}, counted, s, context.settings->through_transmission);
}

/// Everything that the film wants of one pixel. Tracers of flow may be null with their scenes.
template <Tracer T>
KERNEL Probe make_probe(const ProbeContext& context, const T* const (&tracers)[3], PlaneSet wanted,
                        vec2 raster, u32& rays) {
  const SceneView& scene = *context.now.scene;
  const CameraView& camera = *context.now.camera;
  const bool through = context.settings->through_transmission;
  const Ray ray = camera_ray(camera, raster, {0, true});
  const Hit hit = probe_closest(scene, CountedTracer<T>{*tracers[0], rays}, ray, through);
  if (const Collision at = probed_volume(scene, ray, hit); at.volume != kNone) {
    return probe_in_volume(context, tracers, at, ray, rays);
  }
  const bool forward = context.forward.scene && (wanted & kForwardPlanes);
  const bool backward = context.backward.scene && (wanted & kBackwardPlanes);
  Probe p = empty_probe();
  if (!(ray.t_max > 0)) return p;
  if (hit.instance == kNone) {
    if (forward) put_flow(p, background_flow(context, context.forward, ray, raster), true);
    if (backward) put_flow(p, background_flow(context, context.backward, ray, raster), false);
    return p;
  }
  probe_surface(p, context.now, hit, ray, wanted);
  if (forward) {
    const CountedTracer<T> counted{*tracers[1], rays};
    put_flow(p, flow_to(context, context.forward, counted, hit, p.p_world), true);
  }
  if (backward) {
    const CountedTracer<T> counted{*tracers[2], rays};
    put_flow(p, flow_to(context, context.backward, counted, hit, p.p_world), false);
  }
  if (context.disparity && (wanted & kDisparityPlanes)) {
    const Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
    probe_disparity(p, context, CountedTracer<T>{*tracers[0], rays}, s);
  }
  return p;
}

template <class T, int N, class Value>
KERNEL void put_plane(void* plane, u64 pixel, const Value& value) {
  T* out = static_cast<T*>(plane) + pixel * N;
  if constexpr (N == 1) {
    out[0] = T(value);
  } else {
    for (int i = 0; i < N; ++i) out[i] = value[i];
  }
}

/// Writes the centre planes of pixel (x, y); returns rays traced. The tracers of flow may be null
/// where their scenes are.
template <Tracer T>
KERNEL u32 probe_pixel(const ProbeContext& context, const T& tracer, const T* forward_tracer,
                       const T* backward_tracer, const FilmView& film, u32 x, u32 y) {
  u32 rays = 0;
  const u64 pixel = u64(y) * film.width + x;
  const vec2 raster(float(x) + 0.5f, float(y) + 0.5f);
  const T* const tracers[3] = {&tracer, forward_tracer, backward_tracer};
  const CameraAt camera(*context.now.camera, row_time(*context.now.camera, raster.y));
  ProbeContext at_row = context;
  at_row.now.camera = &camera.camera();
  const Probe p = make_probe<T>(at_row, tracers, film.wanted, raster, rays);
#define HELIO_PUT_kMean(...)
#define HELIO_PUT_kFilm(...)
#define HELIO_PUT_kPost(...)
#define HELIO_PUT_kCentre(NAME, type, channels, expression) \
  if (wants(film, Plane::NAME))                             \
    put_plane<type, channels>(film.planes[u32(Plane::NAME)], pixel, expression);
#define HELIO_PUT(NAME, type, channels, fold, unit, expression) \
  HELIO_PUT_##fold(NAME, type, channels, expression)
  HELIO_PLANES(HELIO_PUT)
#undef HELIO_PUT
#undef HELIO_PUT_kCentre
#undef HELIO_PUT_kPost
#undef HELIO_PUT_kFilm
#undef HELIO_PUT_kMean
  return rays;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
