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

/// A direction towards light, from a given point.
struct LightSample {
  vec3 direction;  // unit, world
  vec3 target;     // just before the light; meaningless for the dome
  vec3 radiance;   // W sr^-1 m^-2
  float pdf;       // 1/sr, the choice of the light included
  u32 visibility;  // ray mask bits of the emitting instance
  bool infinite;   // the dome
};

// ---------------------------------------------------------------- surfaces

/// Radiance that a point of a surface emits towards the side `front`.
KERNEL vec3 emitted(const SceneView& scene, const Surface& s, const MaterialValues& m, bool front) {
  if (s.material->unlit) return m.base_color;
  vec3 radiance(0);
  if (front || s.material->two_sided_emission) radiance = m.emission * m.emission_strength;
  if (s.light == kNone) return radiance;
  const LightView& light = scene.lights[s.light];
  if (!front && !light.light_two_sided) return radiance;
  vec3 added = light.radiance;
  if (light.texture.texture != kNone) {
    added *= glm::max(vec3(sample_use<true>(scene, light.texture, s.uvs)), vec3(0));
  }
  return radiance + added;
}

/// A triangle of a light in world space.
struct LightTriangle {
  vec3 a, ab, ac;
  vec3 normal;        // of the front side, its length twice the area
  float probability;  // of the triangle among all lights
  Corners corners;    // in object space
};
KERNEL LightTriangle light_triangle(const SceneView& scene, const LightView& light, u32 primitive) {
  const InstanceView& instance = scene.instances[light.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const Corners c = corners_of(mesh.positions, mesh.triangles[primitive]);
  const mat4x3& world = instance.world_from_object;
  LightTriangle t;
  t.corners = c;
  t.a = transform_point(world, c.a);
  t.ab = transform_vector(world, c.ab);
  t.ac = transform_vector(world, c.ac);
  t.normal = cross(t.ab, t.ac);
  if (instance.flags & kFlipped) t.normal = -t.normal;
  t.probability =
      light.probability * 0.5f * length(cross(c.ab, c.ac)) / mesh.part_areas[light.part];
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
KERNEL float light_pdf(const SceneView& scene, const Hit& hit, u32 light, vec3 direction) {
  return triangle_pdf(light_triangle(scene, scene.lights[light], hit.primitive), direction, hit.t);
}

KERNEL bool sample_surface_light(const SceneView& scene, u32 index, vec3 p, float u, vec2 u2,
                                 LightSample& out) {
  const LightView& light = scene.lights[index];
  const InstanceView& instance = scene.instances[light.instance];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const u32 first = mesh.part_offsets[light.part];
  const u32 count = mesh.part_offsets[light.part + 1] - first;
  if (count == 0) return false;
  const u32 primitive = mesh.part_triangles[first + choose(mesh.part_cdf + first, count, u).index];
  const LightTriangle t = light_triangle(scene, light, primitive);
  const vec2 barycentric = sample_triangle(u2);
  out.target = t.a + t.ab * barycentric.x + t.ac * barycentric.y;
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
  const float offset = plane_error(instance.world_from_object, t.corners, n);
  out.target += n * (front ? offset : -offset);
  out.visibility = instance.visibility;
  out.infinite = false;
  if (!light.material_emits && light.texture.texture == kNone && !(instance.flags & kMayBeHole)) {
    out.radiance = light.radiance;
    return true;
  }
  const Surface s = surface_at(scene, light.instance, primitive, barycentric);
  out.radiance = emitted(scene, s, material_at(scene, s, kEmissionBits), front);
  if (instance.flags & kMayBeHole) {
    out.radiance *= opacity_at(scene, light.instance, primitive, barycentric);
  }
  return !is_black(out.radiance);
}

// ---------------------------------------------------------------- dome

KERNEL vec3 dome_texel(const SceneView& scene, vec2 uv) {
  TextureView texture = scene.textures[scene.dome.texture];
  texture.wrap_u = Wrap::kRepeat;
  texture.wrap_v = Wrap::kClamp;
  return scene.dome.radiance * vec3(sample_texture<true>(texture, uv));
}

/// Place of a direction in the dome's picture, row 0 at v = 0 here, and the sine of its polar
/// angle.
struct DomePlace {
  vec2 uv;
  float sine;
};
KERNEL DomePlace dome_place(const DomeView& dome, vec3 direction) {
  const vec3 d = dome.dome_from_world * direction;
  const float sine = std::sqrt(d.x * d.x + d.y * d.y);
  return {vec2(0.5f - atan2_turns(d.y, d.x), 2 * atan2_turns(sine, d.z)), sine};
}

struct DomeLight {
  vec3 radiance;
  float pdf;  // 1/sr, the choice of the dome included
};
/// Light from a direction, and the density with which sample_light would have taken it.
KERNEL DomeLight dome_light(const SceneView& scene, vec3 direction) {
  const DomeView& dome = scene.dome;
  const float uniform = dome.probability * (0.25f * kInvPi);
  if (dome.texture == kNone) return {dome.radiance, uniform};
  const DomePlace place = dome_place(dome, direction);
  const vec3 radiance = dome_texel(scene, vec2(place.uv.x, 1 - place.uv.y));
  if (!dome.row_cdf || dome.probability <= 0) return {radiance, uniform};
  const u32 x = min2(u32(max2(place.uv.x, 0.0f) * float(dome.width)), dome.width - 1);
  const u32 y = min2(u32(place.uv.y * float(dome.height)), dome.height - 1);
  const float* columns = dome.column_cdf + u64(y) * dome.width;
  const float row = dome.row_cdf[y] - (y > 0 ? dome.row_cdf[y - 1] : 0);
  const float column = columns[x] - (x > 0 ? columns[x - 1] : 0);
  const float texels = float(dome.width) * float(dome.height);
  const float sine = max2(place.sine, 1e-6f);
  return {radiance, dome.probability * row * column * texels / (2 * kPi * kPi * sine)};
}

KERNEL bool sample_dome(const SceneView& scene, vec2 u, LightSample& out) {
  const DomeView& dome = scene.dome;
  out.infinite = true;
  out.visibility = kAllRays;
  if (dome.texture == kNone || !dome.row_cdf) {
    out.direction = sample_sphere(u);
    const DomeLight light = dome_light(scene, out.direction);
    out.radiance = light.radiance;
    out.pdf = light.pdf;
    return !is_black(out.radiance);
  }
  const Choice row = choose(dome.row_cdf, dome.height, u.y);
  const Choice column = choose(dome.column_cdf + u64(row.index) * dome.width, dome.width, u.x);
  const vec2 uv((float(column.index) + column.rest) / float(dome.width),
                (float(row.index) + row.rest) / float(dome.height));
  const SinCos theta = sincos_turns(0.5f * uv.y);
  const SinCos phi = sincos_turns(0.5f - uv.x);
  if (theta.sin <= 1e-6f) return false;
  out.direction = dome.world_from_dome * vec3(theta.sin * phi.cos, theta.sin * phi.sin, theta.cos);
  const float texels = float(dome.width) * float(dome.height);
  out.pdf = dome.probability * row.probability * column.probability * texels /
            (2 * kPi * kPi * theta.sin);
  out.radiance = dome_texel(scene, vec2(uv.x, 1 - uv.y));
  return out.pdf > 0 && !is_black(out.radiance);
}

// ---------------------------------------------------------------- all

/// Whether a light shows to every kind of ray that scattering makes. If not, only sample_light()
/// and mirrors count it.
KERNEL bool shows_to_all(u32 visibility) {
  constexpr u32 kScattered = kDiffuseRay | kGlossyRay | kTransmissionRay;
  return (visibility & kScattered) == kScattered;
}

KERNEL bool has_lights(const SceneView& scene) {
  return scene.light_count > 0 || scene.dome.probability > 0;
}

/// Chooses a light and a direction from p to it; false when no light comes from there.
///
/// u, u2   uniform in [0, 1)
KERNEL bool sample_light(const SceneView& scene, vec3 p, float u, vec2 u2, LightSample& out) {
  const float surfaces = scene.light_count > 0 ? scene.light_cdf[scene.light_count - 1] : 0;
  if (u >= surfaces) return scene.dome.probability > 0 && sample_dome(scene, u2, out);
  const Choice light = choose(scene.light_cdf, scene.light_count, u);
  return sample_surface_light(scene, light.index, p, light.rest, u2, out);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
