#include "renderer/host/overlap.h"

#include <array>

#include "renderer/scene/motion.h"

namespace heliograph::host {

namespace {

constexpr kernels::HoleKey kProbe{0, true};

Box object_bounds(const Placement& placement, u32 slot) {
  return placement.mesh(slot).accelerator->bounds();
}

/// A box as seen through an affine map: the bounds of its corners.
Box transformed(const mat4x3& map, const Box& box) {
  Box out;
  for (u32 i = 0; i < 8; ++i)
    out.extend(map * vec4(i & 1 ? box.upper.x : box.lower.x, i & 2 ? box.upper.y : box.lower.y,
                          i & 4 ? box.upper.z : box.lower.z, 1));
  return out;
}

bool apart(const Box& a, const Box& b) {
  for (int i = 0; i < 3; ++i)
    if (a.upper[i] < b.lower[i] || b.upper[i] < a.lower[i]) return true;
  return false;
}

/// Casts features of one slot, given in its object space, against another slot alone.
class Caster {
 public:
  Caster(const Placement& placement, const HostTracer& tracer, u32 from, u32 against)
      : tracer_(tracer),
        placement_(placement),
        against_(against),
        world_from_object_(placement.instances()[from].world_from_object),
        bounds_(object_bounds(placement, against)),
        object_from_other_(multiply(placement.instances()[against].object_from_world,
                                    placement.instances()[from].world_from_object)) {}

  [[nodiscard]] bool near(vec3 p, vec3 q) const {
    Box segment;
    segment.extend(object_from_other_ * vec4(p, 1));
    segment.extend(object_from_other_ * vec4(q, 1));
    return !apart(segment, bounds_);
  }
  [[nodiscard]] bool crosses(vec3 p, vec3 q) const {
    const vec3 a = world_from_object_ * vec4(p, 1), b = world_from_object_ * vec4(q, 1);
    const kernels::Ray ray{a, b - a, 1, 0, kProbe};  // t counts lengths of the segment
    return tracer_.closest_in(against_, ray).instance != kNone;
  }
  [[nodiscard]] bool contains(vec3 p) const {
    if (!near(p, p)) return false;
    const vec3 direction = glm::normalize(vec3(0.5377f, 0.6841f, 0.4932f));
    const kernels::Ray ray{world_from_object_ * vec4(p, 1), direction, INFINITY, 0, kProbe};
    const kernels::Hit hit = tracer_.closest_in(against_, ray);
    if (hit.instance == kNone) return false;
    const DeviceMesh& mesh = placement_.mesh(against_);
    const uvec3 t = mesh.topology->triangles[hit.primitive];
    const mat3 linear(placement_.instances()[against_].world_from_object);
    const vec3 e1 = linear * (mesh.positions[t.y] - mesh.positions[t.x]);
    const vec3 e2 = linear * (mesh.positions[t.z] - mesh.positions[t.x]);
    return glm::dot(glm::cross(e1, e2) * glm::sign(glm::determinant(linear)), direction) > 0;
  }

 private:
  const HostTracer& tracer_;
  const Placement& placement_;
  u32 against_;
  mat4x3 world_from_object_;
  Box bounds_;
  mat4x3 object_from_other_;
};

bool some_edge_crosses(const Placement& placement, const Caster& caster, u32 from) {
  const DeviceMesh& mesh = placement.mesh(from);
  for (const uvec3& t : mesh.topology->triangles)
    for (int i = 0; i < 3; ++i) {
      const u32 v = t[i], w = t[(i + 1) % 3];
      const vec3 p = mesh.positions[v], q = mesh.positions[w];
      if (caster.near(p, q) && caster.crosses(p, q)) return true;
    }
  return false;
}

bool first_vertex_inside(const Placement& placement, const Caster& caster, u32 from) {
  const DeviceMesh& mesh = placement.mesh(from);
  return !mesh.topology->triangles.empty() &&
         caster.contains(mesh.positions[mesh.topology->triangles[0].x]);
}

}  // namespace

bool overlap(const Placement& placement, const HostTracer& tracer, u32 a, u32 b) {
  const auto world = [&](u32 slot) {
    return transformed(placement.instances()[slot].world_from_object,
                       object_bounds(placement, slot));
  };
  if (apart(world(a), world(b))) return false;
  for (const auto& [from, against] : {std::array{a, b}, std::array{b, a}}) {
    const Caster caster(placement, tracer, from, against);
    if (some_edge_crosses(placement, caster, from) || first_vertex_inside(placement, caster, from))
      return true;
  }
  return false;
}

}  // namespace heliograph::host
