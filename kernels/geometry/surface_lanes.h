// Surfaces that rays have met, in lanes: surface_at() of surface.h. Called by lockstep.h.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include <new>

#include "kernels/core/lanes.h"
#include "kernels/geometry/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Asks for what surface_at() reads first.
HELIO_ALWAYS_INLINE KERNEL void prefetch_triangle(const SceneView& scene, const Hit& hit) {
  prefetch(scene.meshes[scene.instances[hit.instance].mesh].triangles + hit.primitive);
}
/// Asks for what it reads then.
HELIO_ALWAYS_INLINE KERNEL void prefetch_corners(const SceneView& scene, const Hit& hit) {
  const MeshView& mesh = scene.meshes[scene.instances[hit.instance].mesh];
  const uvec3 triangle = mesh.triangles[hit.primitive];
  for (int i = 0; i < 3; ++i) {
    prefetch(mesh.positions + triangle[i]);
    if (mesh.normals) prefetch(mesh.normals + triangle[i]);
  }
}

/// Hits side by side, 1 to kLanes of them. Lanes that hold none read what the first does.
struct HitLanes {
  u32 count = 0;
  const Hit* hits[kLanes];
  float times[kLanes];
  Surface* to[kLanes];  // where their surfaces are to be
};

/// An address in each lane.
using Addresses = const float* [kLanes];
KERNEL Vec3<Floats> read3(const Addresses& at) {
  return read3([&](u32 i) { return at[i]; });
}
KERNEL Mat4x3<Floats> read_matrix(const Addresses& at) {
  const FourOf<Floats> a = read4([&](u32 i) { return at[i]; });
  const FourOf<Floats> b = read4([&](u32 i) { return at[i] + 4; });
  const FourOf<Floats> c = read4([&](u32 i) { return at[i] + 8; });
  Mat4x3<Floats> m;
  m[0] = {a.of[0], a.of[1], a.of[2]};
  m[1] = {a.of[3], b.of[0], b.of[1]};
  m[2] = {b.of[2], b.of[3], c.of[0]};
  m[3] = {c.of[1], c.of[2], c.of[3]};
  return m;
}

/// Addresses and numbers that the surface of each lane is computed from.
struct SurfaceLanes {
  Addresses world_from_object, object_from_world;
  Addresses corners[3];  // of triangles
  Addresses normals[3];
  Vec2<Floats> barycentric{0};
  Mask has_normals = false;
};
/// True for triangles and flat shapes that do not deform: corners and normals are read where the
/// mesh has them.
KERNEL bool is_rigid_triangle(const MeshView& mesh) {
  return mesh.segments == 0 && !has_curves(mesh) && !is_round(mesh.shape);
}
KERNEL void add(SurfaceLanes& lanes, u32 i, const Surface& s) {
  const MeshView& mesh = *s.mesh;
  const InstanceView& instance = *s.instance;
  const bool moves = instance.segments > 0;
  const float* const world = &(moves ? s.pose.world_from_object : instance.world_from_object)[0].x;
  lanes.world_from_object[i] = world;
  lanes.object_from_world[i] =
      &(moves ? s.pose.object_from_world : instance.object_from_world)[0].x;
  const bool rigid = is_rigid_triangle(mesh);
  for (int k = 0; k < 3; ++k) {
    lanes.corners[k][i] = rigid ? &mesh.positions[s.triangle[k]].x : world;
    lanes.normals[k][i] = rigid && mesh.normals ? &mesh.normals[s.triangle[k]].x : world;
  }
  put(lanes.barycentric, i, s.barycentric);
  put(lanes.has_normals, i, mesh.normals != nullptr);
}

/// surface_at() of each hit.
KERNEL void surfaces_at(const SceneView& scene, const HitLanes& met) {
  SurfaceLanes lanes;
  Floats times = 0;
  u32 others = 0;
  for (u32 i = 0; i < kLanes; ++i) {
    if (i < met.count) {
      const Hit& hit = *met.hits[i];
      new (met.to[i]) Surface(
          met_surface(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), met.times[i]));
      if (!is_rigid_triangle(*met.to[i]->mesh)) others |= 1u << i;
    }
    const Surface& s = *met.to[i < met.count ? i : 0];
    put(times, i, s.time);
    add(lanes, i, s);
  }
  const Vec3<Floats> a = read3(lanes.corners[0]);
  PrimitiveSurfaceOf<Floats> own = Triangles::surface(
      CornersOf<Vec3<Floats>>{a, read3(lanes.corners[1]) - a, read3(lanes.corners[2]) - a},
      lanes.barycentric);
  Vec3<Floats> n = interpolate(read3(lanes.normals[0]), read3(lanes.normals[1]),
                               read3(lanes.normals[2]), lanes.barycentric);
  for (; others != 0; others &= others - 1) {
    const u32 i = lowest_bit(others);
    const Surface& s = *met.to[i];
    const Hit& hit = *met.hits[i];
    const PrimitiveSurface one =
        primitive_surface({*s.mesh, hit.primitive, s.time}, vec2(hit.u, hit.v));
    put(own.p, i, one.p);
    put(own.normal, i, one.normal);
    put(own.extent.a, i, one.extent.a);
    put(own.extent.ab, i, one.extent.ab);
    put(own.extent.ac, i, one.extent.ac);
    if (s.mesh->normals) put(n, i, vertex_normal_at(*s.mesh, s.triangle, s.barycentric, s.time));
  }
  const ObjectPoseOf<Floats> pose{read_matrix(lanes.world_from_object),
                                  read_matrix(lanes.object_from_world)};
  const WorldSurfaceOf<Floats> world = world_surface(pose, own);
  const Vec3<Floats> ns = select(lanes.has_normals, world_normal(pose, n, world.ng), world.ng);
  const Vec3<Floats>&p = world.p, &ng = world.ng;
  Surface unused;  // of lanes that hold none
  const auto to = [&](u32 i) { return i < met.count ? met.to[i] : &unused; };
  write4([&](u32 i) { return &to(i)->p.x; }, p.x, p.y, p.z, world.offset);
  write4([&](u32 i) { return &to(i)->ng.x; }, ng.x, ng.y, ng.z, times);
  for (u32 i = 0; i < met.count; ++i) {
    Surface& s = *met.to[i];
    s.ns = tilted_normal(scene, s, get(ns, i));
  }
}

}  // namespace heliograph::kernels::inline HELIO_ISA
