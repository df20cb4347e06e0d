// What surfaces and the sky emit, and how directions to them are chosen. Called by path.h.
#pragma once

#include "kernels/surface.h"
#include "kernels/warp.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Weight of a strategy with density a against one with density b.
///
/// Source: Veach and Guibas 1995, "Optimally Combining Sampling Techniques for Monte Carlo
/// Rendering", section 3.3 (power heuristic, exponent 2).
KERNEL float mis_weight(float a, float b) { return 1 / (1 + sqr(b / a)); }

/// A direction towards light, from a given point. What comes from there is light_radiance().
struct LightSample {
  vec3 direction;  // unit, world
  vec3 target;     // just before the light; meaningless for the dome
  float pdf;       // 1/sr, the choice of the light included
  u32 light;       // index into SceneView::lights; kNone: the dome
  u32 primitive = 0;
  float time = 0;     // of the ray
  vec2 place;         // barycentric; for the dome in its picture, row 0 at v = 0
  bool front = true;  // the light shows its front
  u32 visibility;     // ray mask bits of the emitting instance
};

// ---------------------------------------------------------------- surfaces

/// Radiance that a point of a surface emits towards the side `front`, and that sample_light()
/// counts where the surface belongs to a light.
KERNEL vec3 emitted(const SceneView& scene, const Surface& s, const MaterialValues& m, bool front) {
  vec3 radiance(0);
  const MaterialView& material = *s.material;
  if (!material.unlit && (front || material.two_sided_emission)) {
    radiance = m.emission * m.emission_strength;
  }
  if (s.light == kNone) return radiance;
  const LightView& light = scene.lights[s.light];
  if (!front && !light.light_two_sided) return radiance;
  vec3 added = light.radiance;
  if (light.texture.texture != kNone) {
    added *= glm::max(vec3(sample_use<true>(scene, light.texture, uvs_at(s))), vec3(0));
  }
  return radiance + added;
}

/// What a surface shows of itself besides: the colour of unlit materials, which is light to whoever
/// meets it but that sample_light() does not know.
KERNEL vec3 shown(const Surface& s, const MaterialValues& m) {
  return s.material->unlit ? m.base_color : vec3(0);
}

/// A triangle of a light in world space.
struct LightTriangle {
  vec3 a, ab, ac;
  vec3 normal;        // of the front side, its length twice the area
  float probability;  // of the triangle among all lights
  Corners corners;    // in object space
  mat4x3 world_from_object;
};
KERNEL LightTriangle light_triangle(const SceneView& scene, const LightView& light, u32 primitive,
                                    float time) {
  const InstanceView& instance = scene.instances[light.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const Corners c = corners_at(mesh, mesh.triangles[primitive], time);
  LightTriangle t;
  t.world_from_object = pose_at(scene, instance, time).world_from_object;
  const mat4x3& world = t.world_from_object;
  t.corners = c;
  t.a = transform_point(world, c.a);
  t.ab = transform_vector(world, c.ab);
  t.ac = transform_vector(world, c.ac);
  t.normal = cross(t.ab, t.ac);
  if (instance.flags & kFlipped) t.normal = -t.normal;
  // Triangles are chosen by their areas before they deform.
  const Corners rest =
      mesh.segments == 0 ? c : corners_of(mesh.positions, mesh.triangles[primitive]);
  t.probability =
      light.probability * 0.5f * length(cross(rest.ab, rest.ac)) / mesh.part_areas[light.part];
  return t;
}

/// Density [1/sr] of a direction to a point of a triangle of area |normal| / 2 that is chosen with
/// t.probability. d: unit.
KERNEL float triangle_pdf(const LightTriangle& t, vec3 d, float distance) {
  const float projected = 0.5f * std::fabs(dot(t.normal, d));
  return projected > 0 ? t.probability * sqr(distance) / projected : 0;
}

/// Density [1/sr] with which sample_light would have taken the direction in which a ray met a
/// light.
KERNEL float light_pdf(const SceneView& scene, const Hit& hit, u32 light, const Ray& ray) {
  const LightTriangle t = light_triangle(scene, scene.lights[light], hit.primitive, ray.time);
  return triangle_pdf(t, ray.direction, hit.t);
}

KERNEL bool sample_surface_light(const SceneView& scene, u32 index, vec3 p, float u, vec2 u2,
                                 float time, LightSample& out) {
  const LightView& light = scene.lights[index];
  const InstanceView& instance = scene.instances[light.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const u32 first = mesh.part_offsets[light.part];
  const u32 count = mesh.part_offsets[light.part + 1] - first;
  if (count == 0) return false;
  const u32 primitive = mesh.part_triangles[first + choose(mesh.part_cdf + first, count, u).index];
  const LightTriangle t = light_triangle(scene, light, primitive, time);
  out.place = sample_triangle(u2);
  out.target = t.a + t.ab * out.place.x + t.ac * out.place.y;
  const vec3 d = out.target - p;
  const float distance2 = dot(d, d);
  const bool front = dot(d, t.normal) < 0;
  const bool emits =
      front || light.light_two_sided || (light.material_emits && light.material_two_sided);
  if (!emits || !(distance2 > 0)) return false;
  const float distance = std::sqrt(distance2);
  out.direction = d / distance;
  out.pdf = triangle_pdf(t, out.direction, distance);
  if (!(out.pdf > 0)) return false;
  const vec3 n = normalize(t.normal);
  const float offset = plane_error(t.world_from_object, t.corners, n);
  out.target += n * (front ? offset : -offset);
  out.light = index;
  out.primitive = primitive;
  out.time = time;
  out.front = front;
  out.visibility = instance.visibility;
  return true;
}

/// Radiance of a sampled point of a surface.
KERNEL vec3 surface_radiance(const SceneView& scene, const LightSample& sample) {
  const LightView& light = scene.lights[sample.light];
  const bool holes = scene.instances[light.instance].flags & kMayBeHole;
  if (!light.material_emits && light.texture.texture == kNone && !holes) return light.radiance;
  const Surface s = locate(scene, light.instance, sample.primitive, sample.place, sample.time);
  const vec3 radiance = emitted(scene, s, material_at(scene, s, kEmissionBits), sample.front);
  if (!holes) return radiance;
  return radiance * opacity_at(scene, light.instance, sample.primitive, sample.place);
}

// ---------------------------------------------------------------- dome

/// place: row 0 at v = 0.
KERNEL vec3 dome_radiance(const SceneView& scene, vec2 place) {
  const DomeView& dome = scene.dome;
  if (dome.texture == kNone) return dome.radiance;
  TextureView texture = scene.textures[dome.texture];
  texture.wrap_u = Wrap::kRepeat;
  texture.wrap_v = Wrap::kClamp;
  return dome.radiance * vec3(sample_texture<true>(texture, vec2(place.x, 1 - place.y)));
}

/// Place of a direction in the dome's picture, and the sine of its polar angle.
struct DomePlace {
  vec2 uv;
  float sine;
};
KERNEL DomePlace dome_place(const DomeView& dome, vec3 direction) {
  const vec3 d = dome.dome_from_world * direction;
  const float sine = std::sqrt(d.x * d.x + d.y * d.y);
  return {vec2(0.5f - atan2_turns(d.y, d.x), 2 * atan2_turns(sine, d.z)), sine};
}

/// From the probability of a texel to a density of directions, 1/sr.
KERNEL float dome_density(const DomeView& dome, float probability, float sine) {
  return dome.probability * probability * float(dome.width) * float(dome.height) /
         (2 * kPi * kPi * max2(sine, 1e-6f));
}

/// Density [1/sr] with which sample_light() takes a direction to the dome.
KERNEL float dome_pdf(const DomeView& dome, const DomePlace& place) {
  if (!dome.row_cdf) return dome.probability * (0.25f * kInvPi);
  const u32 x = min2(u32(max2(place.uv.x, 0.0f) * float(dome.width)), dome.width - 1);
  const u32 y = min2(u32(place.uv.y * float(dome.height)), dome.height - 1);
  const float* columns = dome.column_cdf + u64(y) * dome.width;
  const float row = dome.row_cdf[y] - (y > 0 ? dome.row_cdf[y - 1] : 0);
  const float column = columns[x] - (x > 0 ? columns[x - 1] : 0);
  return dome_density(dome, row * column, place.sine);
}

/// The column that u falls into, within a row. The guide narrows the search to a few neighbours.
KERNEL Choice choose_column(const DomeView& dome, u32 row, float u) {
  const float* cdf = dome.column_cdf + u64(row) * dome.width;
  if (!dome.column_guide) return choose(cdf, dome.width, u);
  const u16* guide = dome.column_guide + u64(row) * kDomeGuide;
  const u32 i = min2(u32(u * kDomeGuide), kDomeGuide - 1);
  const u32 last = i + 1 < kDomeGuide ? guide[i + 1] : dome.width - 1;
  return choose(cdf, guide[i], last + 1 - guide[i], u);
}

KERNEL bool sample_dome(const SceneView& scene, vec2 u, LightSample& out) {
  const DomeView& dome = scene.dome;
  out.light = kNone;
  out.visibility = kAllRays;
  if (!dome.row_cdf) {
    out.direction = sample_sphere(u);
    out.place = dome.texture == kNone ? vec2(0) : dome_place(dome, out.direction).uv;
    out.pdf = dome.probability * (0.25f * kInvPi);
    return true;
  }
  const Choice row = choose(dome.row_cdf, dome.height, u.y);
  const Choice column = choose_column(dome, row.index, u.x);
  out.place = vec2((float(column.index) + column.rest) / float(dome.width),
                   (float(row.index) + row.rest) / float(dome.height));
  const SinCos theta = sincos_turns(0.5f * out.place.y);
  const SinCos phi = sincos_turns(0.5f - out.place.x);
  out.direction = dome.world_from_dome * vec3(theta.sin * phi.cos, theta.sin * phi.sin, theta.cos);
  out.pdf = dome_density(dome, row.probability * column.probability, theta.sin);
  return theta.sin > 1e-6f && out.pdf > 0;
}

// ---------------------------------------------------------------- all

/// Radiance that arrives along a sampled direction if nothing stands in the way.
KERNEL vec3 light_radiance(const SceneView& scene, const LightSample& sample) {
  return sample.light == kNone ? dome_radiance(scene, sample.place)
                               : surface_radiance(scene, sample);
}

/// Whether a light shows to every kind of ray that scattering makes. If not, only sample_light()
/// and mirrors count it.
KERNEL bool shows_to_all(u32 visibility) {
  constexpr u32 kScattered = kDiffuseRay | kGlossyRay | kTransmissionRay;
  return (visibility & kScattered) == kScattered;
}

KERNEL bool has_lights(const SceneView& scene) {
  return scene.light_count > 0 || scene.dome.probability > 0;
}

/// Chooses a light and a direction from p to it at a time; false when no light comes from there.
///
/// u, u2   uniform in [0, 1)
KERNEL bool sample_light(const SceneView& scene, vec3 p, float time, float u, vec2 u2,
                         LightSample& out) {
  const float surfaces = scene.light_count > 0 ? scene.light_cdf[scene.light_count - 1] : 0;
  if (u >= surfaces) return scene.dome.probability > 0 && sample_dome(scene, u2, out);
  const Choice light = choose(scene.light_cdf, scene.light_count, u);
  return sample_surface_light(scene, light.index, p, light.rest, u2, time, out);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
