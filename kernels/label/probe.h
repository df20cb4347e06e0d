// Labels: what the ray through a pixel's centre meets, exactly and without noise. probe_pixel() is
// the entry point of every backend.
#pragma once

#include "kernels/label/probe_sight.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL void put_flow(Probe& p, const Flow& flow, bool forward) {
  (forward ? p.flow_forward : p.flow_backward) = flow.pixels;
  (forward ? p.flow_forward_valid : p.flow_backward_valid) = flow.valid;
  (forward ? p.flow_forward_visible : p.flow_backward_visible) = flow.visible;
  if (forward) p.scene_flow = flow.metres;
}

/// Answer of a probe that meets nothing.
KERNEL Probe empty_probe() {
  Probe p{};
  p.p_world = p.p_camera = p.object_coordinates = p.nocs = vec3(NAN);
  p.material_id = p.primitive = kNone;
  p.distance = INFINITY;
  return p;
}

/// Fills in its place at t along the ray. The camera's frame does not go through the world's, which
/// rounds more the farther its origin is.
KERNEL void probe_point(Probe& p, const CameraView& camera, const Sight& sight, float t) {
  const Ray& ray = sight.ray;
  const vec3 along = ray.direction * t;
  p.distance = t + sight.passed;
  p.p_world = ray.origin + along;
  p.p_camera = turn_to_camera(camera, ray.origin - camera.world_from_camera[3] + along);
}

KERNEL void probe_geometry(Probe& p, const Surface& s, const CameraView& camera, const Sight& sight,
                           float t) {
  const Ray& ray = sight.ray;
  probe_point(p, camera, sight, t);
  p.geometric_normal = dot(s.ng, ray.direction) > 0 ? -s.ng : s.ng;
}

KERNEL void probe_shading(Probe& p, const Surface& s, const CameraView& camera, const Ray& ray) {
  p.normal = dot(s.ng, ray.direction) > 0 ? -s.ns : s.ns;
  p.normal_camera = normalize(cv_from_gl(transform_vector(camera.camera_from_world, p.normal)));
  p.tangent = world_tangent(s, s.ns, tangents_of(s, edges_at(s), 0).t);
}

KERNEL void probe_labels(Probe& p, const Surface& s, const Hit& hit) {
  const InstanceView& instance = *s.instance;
  p.instance_label = instance.label;
  p.category = instance.category;
  const u32 further = instance.flags & kOnePart ? 0 : s.part;
  p.part = instance.label != 0 ? instance.part + further : 0;
  p.material_id = s.material->id;
  p.primitive = hit.primitive;
  p.barycentric = vec2(hit.u, hit.v);
}

KERNEL void probe_rest(Probe& p, const RestBoxView& box, vec3 p_object) {
  p.object_coordinates = transform_point(box.box_from_object, p_object);
  p.nocs = vec3(0.5f) + (p.object_coordinates - vec3(0.5f)) * box.nocs_scale;
}

KERNEL vec3 rest_position(const Surface& s, const Hit& hit) {
  const vec3* rest = s.mesh->rest_positions ? s.mesh->rest_positions : s.mesh->positions;
  if (s.mesh->shape != Shape::kCurves) return interpolate(rest, s.triangle, s.barycentric);
  MeshView at_rest = *s.mesh;
  at_rest.positions = rest;
  at_rest.segments = 0;
  return Curves::surface({at_rest, hit.primitive, 0}, vec2(hit.u, hit.v)).p;
}

/// Fills in what the wanted planes show of the surface itself.
KERNEL void probe_surface(Probe& p, const ProbeContext& context, const Hit& hit, const Sight& sight,
                          PlaneSet wanted) {
  const SceneView& scene = *context.now.scene;
  const Ray& ray = sight.ray;
  Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
  p.hit = true;
  probe_geometry(p, s, *context.now.camera, sight, hit.t);
  probe_labels(p, s, hit);
  if (wanted & planes_from<ProbeShading>()) {
    s.ns = shading_normal(scene, s);
    probe_shading(p, s, *context.now.camera, ray);
  }
  if (wanted & planes_from<ProbeUv>()) p.uv = uvs_at(s).set[0];
  if (wanted & planes_from<ProbeMaterial>()) {
    p.material = material_at(scene, s, ~kAlphaBit);
    p.emission = emitted(scene, s, p.material, -ray.direction) + shown(s, p.material);
  }
  if (wanted & planes_from<ProbeOpacity>()) {
    p.opacity = opacity_at(scene, hit.instance, hit.primitive, s.barycentric);
  }
  if (wanted & planes_from<ProbeRest>())
    probe_rest(p, context.rest_boxes[hit.instance], rest_position(s, hit));
}

/// Fills in what the planes show of the point where a volume's transmittance is one half. It has no
/// normal and no material.
KERNEL void probe_volume(Probe& p, const ProbeContext& context, const Collision& at,
                         const Sight& sight, PlaneSet wanted) {
  const SceneView& scene = *context.now.scene;
  const InstanceView& instance = scene.volumes[at.volume].instance;
  p.hit = true;
  probe_point(p, *context.now.camera, sight, at.t);
  p.instance_label = instance.label;
  p.category = instance.category;
  p.part = instance.label != 0 ? instance.part : 0;
  if (!(wanted & planes_from<ProbeRest>())) return;
  const mat4x3 object_from_world = pose_at(scene, instance, sight.ray.time).object_from_world;
  probe_rest(p, context.rest_boxes[scene.instance_count + at.volume],
             transform_point(object_from_world, p.p_world));
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
  return half_way(scene, ray, min2(ray.t_max, hit.t));
}

/// Disparity of the probed point, of a surface or of a volume.
template <Tracer T, class At>
KERNEL void probe_disparity(Probe& p, const ProbeContext& context, CountedTracer<T> counted,
                            const At& at) {
  const CameraAt second(*context.disparity, context.now.camera->time);
  const CameraView& camera = second.camera();
  const Projected to = project(camera, point_of(at));
  if (!to.seen) return;
  p.disparity = project(*context.now.camera, point_of(at)).raster.x - to.raster.x;
  p.disparity_visible =
      inside_image(camera, to.raster) && camera_sees({context.now.scene, &camera}, counted, at,
                                                     context.settings->through_transmission);
}

template <Tracer T>
KERNEL Probe probe_in_volume(const ProbeContext& context, const T* const (&tracers)[3],
                             const Collision& at, const Sight& sight, PlaneSet wanted, u32& rays) {
  Probe p = empty_probe();
  probe_volume(p, context, at, sight, wanted);
  if (context.forward.scene) {
    const CountedTracer<T> counted{*tracers[1], rays};
    put_flow(p, volume_flow(context, context.forward, counted, at.volume, p.p_world), true);
  }
  if (context.backward.scene) {
    const CountedTracer<T> counted{*tracers[2], rays};
    put_flow(p, volume_flow(context, context.backward, counted, at.volume, p.p_world), false);
  }
  if (context.disparity)
    probe_disparity(p, context, CountedTracer<T>{*tracers[0], rays}, p.p_world);
  return p;
}

/// Everything that the film wants of one pixel. Tracers of flow may be null with their scenes.
template <Tracer T>
KERNEL Probe make_probe(const ProbeContext& context, const T* const (&tracers)[3], PlaneSet wanted,
                        vec2 raster, const Sight& sight, u32& rays) {
  const SceneView& scene = *context.now.scene;
  const Ray& ray = sight.ray;
  if (!(ray.t_max > 0)) return empty_probe();
  const bool through = context.settings->through_transmission;
  const Hit hit =
      refined(scene, ray, sight.direction,
              probe_closest(scene, CountedTracer<T>{*tracers[0], rays}, ray, through, sight.mask));
  if (const Collision at = probed_volume(scene, ray, hit); at.volume != kNone) {
    return probe_in_volume(context, tracers, at, sight, wanted, rays);
  }
  const bool forward = context.forward.scene && (wanted & planes_from<ProbeForward>());
  const bool backward = context.backward.scene && (wanted & planes_from<ProbeBackward>());
  Probe p = empty_probe();
  if (hit.instance == kNone) {
    if (forward) put_flow(p, background_flow(context, context.forward, ray, raster), true);
    if (backward) put_flow(p, background_flow(context, context.backward, ray, raster), false);
    return p;
  }
  probe_surface(p, context, hit, sight, wanted);
  if (forward) {
    const CountedTracer<T> counted{*tracers[1], rays};
    put_flow(p, flow_to(context, context.forward, counted, hit, p.p_world), true);
  }
  if (backward) {
    const CountedTracer<T> counted{*tracers[2], rays};
    put_flow(p, flow_to(context, context.backward, counted, hit, p.p_world), false);
  }
  if (context.disparity && (wanted & planes_from<ProbeStereo>())) {
    Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
    s.p = p.p_world;
    probe_disparity(p, context, CountedTracer<T>{*tracers[0], rays}, s);
  }
  return p;
}

/// Writes the planes that are read from one part of a probe.
template <class Part>
KERNEL void put_part(const FilmView& film, u64 pixel, const Part& from) {
#define HELIO_PUT(NAME, type, channels, fold, unit, part, value)                            \
  if constexpr (std::is_same_v<Part, part>) {                                               \
    if (wants(film, Plane::NAME))                                                           \
      put_value<channels>(static_cast<type*>(film.planes[u32(Plane::NAME)]), pixel, value); \
  }
  HELIO_PLANES(HELIO_PUT)
#undef HELIO_PUT
}

/// Writes the centre planes of a pixel; returns rays traced.
///
/// sight_of   (context at the pixel's time, rays) -> Sight
template <Tracer T, class SightOf>
KERNEL u32 probe_by(const ProbeContext& context, const T* const (&tracers)[3], const FilmView& film,
                    uvec2 at, const SightOf& sight_of) {
  u32 rays = 0;
  const u64 pixel = u64(at.y) * film.width + at.x;
  const vec2 raster = centre_of(at.x, at.y);
  const CameraAt camera(*context.now.camera, pixel_time(*context.now.camera, at.x, at.y));
  ProbeContext at_row = context;
  at_row.now.camera = &camera.camera();
  const Sight sight = sight_of(at_row, rays);
  const Probe p = make_probe<T>(at_row, tracers, film.wanted, raster, sight, rays);
  put_part<ProbeHit>(film, pixel, p);
  put_part<ProbeShading>(film, pixel, p);
  put_part<ProbeUv>(film, pixel, p);
  put_part<ProbeMaterial>(film, pixel, p);
  put_part<ProbeOpacity>(film, pixel, p);
  put_part<ProbeRest>(film, pixel, p);
  put_part<ProbeForward>(film, pixel, p);
  put_part<ProbeBackward>(film, pixel, p);
  put_part<ProbeStereo>(film, pixel, p);
  return rays;
}

/// Writes the centre planes of pixel (x, y); returns rays traced. The tracers of flow may be null
/// where their scenes are.
template <Tracer T>
KERNEL u32 probe_pixel(const ProbeContext& context, const T& tracer, const T* forward_tracer,
                       const T* backward_tracer, const FilmView& film, u32 x, u32 y) {
  const T* const tracers[3] = {&tracer, forward_tracer, backward_tracer};
  return probe_by(context, tracers, film, {x, y}, [&](const ProbeContext& at_row, u32&) {
    return centre_sight(*at_row.now.camera, centre_of(x, y));
  });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
