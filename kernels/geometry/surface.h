// Where and what a hit is: position, normals, texture coordinates, material. Called by path.h and
// probe.h; everything is recomputed from (instance, primitive, barycentrics).
#pragma once

#include <cstddef>

#include "kernels/geometry/primitive.h"
#include "kernels/material/material.h"
#include "kernels/scene/ray.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A point as its material sees it. Directions unit, world; of the front side.
template <class F>
struct ShadingPointOf {
  Vec3<F> wo;  // leaves the surface
  Vec3<F> ng, ns;
  Vec3<F> tangent{0};           // along which anisotropic highlights stretch; zero: anywhere
  Vec3<F> clearcoat_normal{0};  // used where there is clearcoat
  BoolOf<F> thin_walled = false;
  F outside = 1;  // index of refraction of what is on the side that is not the inside
};
using ShadingPoint = ShadingPointOf<float>;

/// A point of a surface, seen from its front (counter-clockwise) side. World space. It begins with
/// rows of four numbers, which lanes read and write.
struct Surface {
  vec3 p;
  float offset;  // metres along ng that leave the surface for certain
  vec3 ng;       // unit, geometric
  float time;    // of the ray that met it
  vec3 ns;       // unit, shading, in the hemisphere of ng
  u32 light;     // index into SceneView::lights, or kNone
  ObjectPose pose;
  const InstanceView* instance;
  const MeshView* mesh;
  const MaterialView* material;
  uvec3 triangle;
  vec2 barycentric;  // of a curve: share of the way from point a to b, and turns around
  u32 part;          // mesh part
};
static_assert(offsetof(Surface, ng) == 16 && offsetof(Surface, ns) == 32);

template <class F>
KERNEL Vec3<F> interpolate(Vec3<F> a, Vec3<F> b, Vec3<F> c, Vec2<F> barycentric) {
  return a + (b - a) * barycentric.x + (c - a) * barycentric.y;
}
KERNEL vec3 interpolate(const vec3* values, uvec3 triangle, vec2 barycentric) {
  return interpolate(values[triangle.x], values[triangle.y], values[triangle.z], barycentric);
}

/// The interpolated vertex normal of a mesh that has normals; not unit, object space.
KERNEL vec3 vertex_normal_at(const MeshView& mesh, uvec3 triangle, vec2 barycentric, float time) {
  if (mesh.segments == 0) return interpolate(mesh.normals, triangle, barycentric);
  const Segment s = segment_at(mesh.segments, time);
  const vec3* normals = mesh.normals + u64(s.index) * mesh.vertex_count;
  return interpolate(normals, triangle, barycentric) * (1 - s.u) +
         interpolate(normals + mesh.vertex_count, triangle, barycentric) * s.u;
}

/// Distance that a point computed from a triangle's corners may lie off its true plane.
///
/// Rounding grows with the magnitude of the corners, in object space and in the pose, not with that
/// of the point: the point of a large triangle near the origin is as uncertain as its corners.
/// After Wächter and Binder 2019, "A Fast and Robust Method for Avoiding Self-Intersection", Ray
/// Tracing Gems chapter 6, which takes the point's magnitude.
template <class F>
KERNEL F plane_error(const Mat4x3<F>& world_from_object, const CornersOf<Vec3<F>>& c, Vec3<F> ng) {
  const Vec3<F> largest = abs3(c.a) + max3(abs3(c.ab), abs3(c.ac));
  const Vec3<F> bound = abs3(world_from_object[0]) * largest.x +
                        abs3(world_from_object[1]) * largest.y +
                        abs3(world_from_object[2]) * largest.z + abs3(world_from_object[3]);
  return 0x1p-19f * (dot(abs3(ng), bound) + 0.0625f * max_component(bound));
}

/// Share of the way to a surface on which rounding of the distance cannot meet it.
inline constexpr float kJustBefore = 1 - 0x1p-18f;

/// The point moved to the side of its surface that `direction` leaves to. ng: on either side
template <class F>
KERNEL Vec3<F> offset_point(Vec3<F> p, Vec3<F> ng, F offset, Vec3<F> direction) {
  return p + ng * select(dot(ng, direction) < 0, -offset, offset);
}
KERNEL vec3 offset_point(const Surface& s, vec3 direction) {
  return offset_point(s.p, s.ng, s.offset, direction);
}

KERNEL Uvs uvs_at(const Surface& s) { return uvs_at(*s.mesh, s.triangle, s.barycentric); }

/// Edges of object space along which a surface's attributes change.
KERNEL Corners edges_at(const Surface& s) {
  if (has_curves(*s.mesh)) return strand_edges(*s.mesh, s.triangle, s.time, s.barycentric);
  return corners_at(*s.mesh, s.triangle, s.time);
}

/// Differences of a set of texture coordinates along those edges.
struct UvEdges {
  vec2 ab, ac;
};
KERNEL UvEdges uv_edges(const Surface& s, const vec2* uvs) {
  const vec2 a = uvs[s.triangle.x];
  const vec2 ab = uvs[s.triangle.y] - a;
  if (has_curves(*s.mesh) && s.mesh->uvs_around && uvs == s.mesh->uvs) return {ab, vec2(0, 1)};
  return {ab, uvs[s.triangle.z] - a};
}

/// Texture coordinates with the width of a ray cone there. A slanted surface is blurred by the
/// narrow side of the cone's ellipse, so never too much.
///
/// width   metres
/// Source: Akenine-Möller et al. 2019, "Texture Level of Detail Strategies for Real-Time Ray
/// Tracing", Ray Tracing Gems chapter 20.
KERNEL Uvs uvs_at(const Surface& s, float width) {
  Uvs uvs = uvs_at(s);
  if (!(width > 0)) return uvs;
  const Corners c = edges_at(s);
  const vec3 ab = transform_vector(s.pose.world_from_object, c.ab);
  const vec3 ac = transform_vector(s.pose.world_from_object, c.ac);
  const vec3 n = cross(ab, ac);
  const float area2 = dot(n, n);
  if (!(area2 > 0)) return uvs;
  const vec2* sets[2] = {s.mesh->uvs, s.mesh->uvs1};
  for (int i = 0; i < 2; ++i) {
    if (!sets[i]) continue;
    const auto [u, v] = uv_edges(s, sets[i]);
    uvs.width[i] = width * std::sqrt(std::fabs(u.x * v.y - u.y * v.x) / std::sqrt(area2));
  }
  return uvs;
}

struct Tangents {
  vec3 t, b;  // object space; t zero when there are none
};

/// Tangents along u and v of a set of texture coordinates, from the mesh or from its uvs; of curves
/// along and around the strand.
///
/// c   edges_at(s)
KERNEL Tangents tangents_of(const Surface& s, const Corners& c, u32 uv_set) {
  if (has_curves(*s.mesh)) return {c.ab, c.ac};
  if (s.mesh->tangents && uv_set == 0) {
    const vec4* all = s.mesh->tangents;
    const vec4 a = all[s.triangle.x];
    const vec3 t = vec3(a) + vec3(all[s.triangle.y] - a) * s.barycentric.x +
                   vec3(all[s.triangle.z] - a) * s.barycentric.y;
    const vec3 n = s.mesh->normals ? vertex_normal_at(*s.mesh, s.triangle, s.barycentric, s.time)
                                   : cross(c.ab, c.ac);
    return {t, cross(n, t) * a.w};
  }
  const vec2* uvs = uv_set ? s.mesh->uvs1 : s.mesh->uvs;
  if (!uvs) return {vec3(0), vec3(0)};
  const auto [ab, ac] = uv_edges(s, uvs);
  const float sign = ab.x * ac.y - ab.y * ac.x < 0 ? -1.0f : 1.0f;
  return {(c.ab * ac.y - c.ac * ab.y) * sign, (c.ac * ab.x - c.ab * ac.x) * sign};
}

/// Unit world tangent orthogonal to the normal ns; zero without texture coordinates.
KERNEL vec3 world_tangent(const Surface& s, vec3 ns, vec3 t_object) {
  const vec3 t = transform_vector(s.pose.world_from_object, t_object);
  return normalize_or(t - ns * dot(ns, t), vec3(0));
}

/// Unit world bitangent on the side of b_object.
KERNEL vec3 world_bitangent(const Surface& s, vec3 ns, vec3 t, vec3 b_object) {
  const vec3 b = cross(ns, t);
  return dot(b, transform_vector(s.pose.world_from_object, b_object)) < 0 ? -b : b;
}

/// The normal ns as a normal map tilts it.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 mapped_normal(const SceneView& scene, Surface s,
                                                          const TextureUseView& use, vec3 ns) {
  const Tangents tangents = tangents_of(s, edges_at(s), use.uv_set & 1);
  const vec3 t = world_tangent(s, ns, tangents.t);
  if (is_black(t)) return ns;
  const vec3 b = world_bitangent(s, ns, t, tangents.b);
  const vec4 texel = sample_texture(scene.textures[use.texture], transform_uv(use, uvs_at(s)));
  const vec3 n((2 * texel.x - 1) * use.scale, (2 * texel.y - 1) * use.scale, 2 * texel.z - 1);
  return normalize_or(t * n.x + b * n.y + ns * n.z, ns);
}

/// The normal ns as the slope of the material's height texture tilts it.
///
/// Source: Mikkelsen 2010, "Bump Mapping Unparametrized Surfaces on the GPU", section 2, which goes
/// back to Blinn 1978.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 bumped_normal(const SceneView& scene, Surface s,
                                                          vec3 ns) {
  const TextureUseView& use = s.material->bump_map;
  const vec2* uvs = use.uv_set & 1 ? s.mesh->uvs1 : s.mesh->uvs;
  if (!uvs) return ns;
  const UvEdges edges = uv_edges(s, uvs);
  const vec2 ab = turn_uv(use, edges.ab), ac = turn_uv(use, edges.ac);
  const float area = ab.x * ac.y - ab.y * ac.x;
  if (!(std::fabs(area) > 0)) return ns;
  const Corners c = edges_at(s);
  const vec3 along_u = transform_vector(s.pose.world_from_object, c.ab * ac.y - c.ac * ab.y) / area;
  const vec3 along_v = transform_vector(s.pose.world_from_object, c.ac * ab.x - c.ab * ac.x) / area;
  const TextureView& texture = scene.textures[use.texture];
  const vec2 uv = transform_uv(use, uvs_at(s));
  const vec2 step(1 / float(texture.width), 1 / float(texture.height));
  const auto height = [&](float u, float v) {
    return sample_texture(texture, uv + step * vec2(u, v))[i32(use.channel)];
  };
  const vec2 slope =
      vec2(height(1, 0) - height(-1, 0), height(0, 1) - height(0, -1)) * (0.5f * use.scale) / step;
  const vec3 across_u = cross(along_v, ns);
  const float det = dot(along_u, across_u);
  const vec3 gradient = across_u * slope.x + cross(ns, along_u) * slope.y;
  return normalize_or(ns * std::fabs(det) - gradient * (det < 0 ? -1.0f : 1.0f), ns);
}

/// Where a surface is, as Surface has it.
template <class F>
struct WorldSurfaceOf {
  Vec3<F> p, ng;
  F offset;
};
template <class F>
KERNEL WorldSurfaceOf<F> world_surface(const ObjectPoseOf<F>& pose,
                                       const PrimitiveSurfaceOf<F>& own) {
  WorldSurfaceOf<F> world;
  world.p = transform_point(pose.world_from_object, own.p);
  world.ng = normalize_or(transform_normal(pose.object_from_world, near_one(own.normal)),
                          Vec3<F>(F(0), F(0), F(1)));
  world.offset = plane_error(pose.world_from_object, own.extent, world.ng);
  return world;
}
/// An interpolated vertex normal in world space, in the hemisphere of ng.
template <class F>
KERNEL Vec3<F> world_normal(const ObjectPoseOf<F>& pose, Vec3<F> n, Vec3<F> ng) {
  const Vec3<F> ns = normalize_or(transform_normal(pose.object_from_world, n), ng);
  return select(dot(ns, ng) < 0, -ns, ns);
}

/// Tells what a ray has met; where it is (p, ng, ns, offset) stays unset.
KERNEL Surface met_surface(const SceneView& scene, u32 instance_index, u32 primitive,
                           vec2 barycentric, float time) {
  Surface s;
  s.time = time;
  s.instance = &scene.instances[instance_index];
  s.mesh = &scene.meshes[s.instance->mesh];
  s.triangle = s.mesh->triangles[primitive];
  if (s.mesh->normals) {  // shading_normal() wants them next
    prefetch(s.mesh->normals + s.triangle.x);
    prefetch(s.mesh->normals + s.triangle.y);
    prefetch(s.mesh->normals + s.triangle.z);
  }
  s.barycentric = barycentric;
  if (has_curves(*s.mesh)) s.barycentric.x = clamp01(barycentric.x);  // no attribute goes beyond
  s.part = part_of(*s.mesh, primitive);
  s.material = &material_of(scene, *s.instance, s.part);
  s.light = scene.light_count > 0 ? scene.part_lights[s.instance->first_part + s.part] : kNone;
  s.pose = pose_at(scene, *s.instance, time);
  return s;
}

/// The surface without its shading: ns is the geometric normal.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL Surface locate(const SceneView& scene, u32 instance_index,
                                                      u32 primitive, vec2 barycentric, float time) {
  Surface s = met_surface(scene, instance_index, primitive, barycentric, time);
  const WorldSurfaceOf<float> world =
      world_surface(s.pose, primitive_surface({*s.mesh, primitive, time}, barycentric));
  s.p = world.p;
  s.ng = world.ng;
  s.ns = world.ng;
  s.offset = world.offset;
  return s;
}

/// The normal of a located surface, interpolated between vertices.
KERNEL vec3 vertex_normal(const Surface& s) {
  if (!s.mesh->normals) return s.ng;
  return world_normal(s.pose, vertex_normal_at(*s.mesh, s.triangle, s.barycentric, s.time), s.ng);
}

/// The normal ns of a located surface, tilted by the material's textures.
KERNEL vec3 tilted_normal(const SceneView& scene, const Surface& s, vec3 ns) {
  const MaterialView& material = *s.material;
  if (material.bump_map.texture != kNone) ns = bumped_normal(scene, s, ns);
  if (material.normal_map.texture != kNone) ns = mapped_normal(scene, s, material.normal_map, ns);
  return ns;
}
/// The shading normal of a located surface: interpolated, then tilted.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 shading_normal(const SceneView& scene,
                                                           const Surface& s) {
  return tilted_normal(scene, s, vertex_normal(s));
}

/// The normal of the clearcoat.
HELIO_GPU_NOINLINE KERNEL vec3 clearcoat_normal(const SceneView& scene, const Surface& s) {
  const vec3 ns = vertex_normal(s);
  const TextureUseView& use = s.material->clearcoat_normal_map;
  return use.texture == kNone ? ns : mapped_normal(scene, s, use, ns);
}

/// The direction in which anisotropic highlights stretch: along u, turned towards v. Without
/// texture coordinates along circles about the object's z axis.
KERNEL vec3 anisotropic_tangent(const Surface& s, float turns) {
  Tangents tangents = tangents_of(s, edges_at(s), 0);
  if (is_black(tangents.t)) {
    const vec3 n = transform_vector(s.pose.object_from_world, s.ns);
    tangents = {vec3(-n.y, n.x, 0), vec3(0, 0, 1)};
  }
  const vec3 t = world_tangent(s, s.ns, tangents.t);
  if (turns == 0 || is_black(t)) return t;
  const SinCos angle = sincos_turns(turns);
  return t * angle.cos + world_bitangent(s, s.ns, t, tangents.b) * angle.sin;
}

KERNEL Surface surface_at(const SceneView& scene, u32 instance_index, u32 primitive,
                          vec2 barycentric, float time) {
  Surface s = locate(scene, instance_index, primitive, barycentric, time);
  s.ns = shading_normal(scene, s);
  return s;
}

/// Material parameters there, with the vertex colours. width: metres of the ray cone, 0: a point.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL MaterialValues material_at(const SceneView& scene,
                                                                  const Surface& s,
                                                                  ParameterSet wanted,
                                                                  float width = 0) {
  MaterialValues values = s.material->textured & wanted
                              ? evaluate_material(scene, *s.material, uvs_at(s, width), wanted)
                              : s.material->constant;
  if (s.mesh->colors) {
    const vec4 color = color_at(*s.mesh, s.triangle, s.barycentric);
    values.base_color *= vec3(color);
    values.alpha *= color.w;
  }
  return values;
}

/// wo: unit, world, leaves the surface
KERNEL ShadingPoint shading_point(const SceneView& scene, const Surface& s, const MaterialValues& m,
                                  vec3 wo) {
  ShadingPoint at{wo, s.ng, s.ns};
  at.thin_walled = s.material->thin_walled;
  if (kRich && m.anisotropic > 0) at.tangent = anisotropic_tangent(s, m.anisotropic_rotation);
  if (kRich && m.clearcoat > 0) at.clearcoat_normal = clearcoat_normal(scene, s);
  return at;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
