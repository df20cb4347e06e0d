// Compiled without fused multiplications: with them an edge need not be the same seen from both of
// its triangles.
#include "renderer/backend/embree/second_look.h"

#include <algorithm>

#include "kernels/bvh/bvh_tracer.h"
#include "renderer/backend/embree/tracer.h"

namespace heliograph::embree {
namespace {

using kernels::Hit;
using kernels::Ray;
using kernels::SceneView;

constexpr u32 kBeside = 8;
constexpr u32 kMost = 6;  // of them: one or two may slip through as the ray did
constexpr u32 kSome = 3;  // of them: others may show more
constexpr float kNearest = 0x1p-21f;

/// Rays beside one, twice as far each time, in directions a golden angle apart: whatever straight
/// edge the ray is at, of three that follow each other one is on each side.
class Beside {
 public:
  /// first   rad, beside the ray
  Beside(const Ray& ray, u32 mask, vec2 first) {
    const float length = glm::length(ray.direction);
    const kernels::Frame frame = kernels::make_frame(ray.direction / length);
    const vec2 turn = 2.0f * vec2(-0.73736888f, 0.67549029f);
    vec2 aside = first * length;
    for (u32 i = 0; i < kBeside; ++i) {
      Ray next = ray;
      next.direction += frame.s * aside.x + frame.t * aside.y;
      aside = {aside.x * turn.x - aside.y * turn.y, aside.x * turn.y + aside.y * turn.x};
      fill(query_, i, next, mask);
    }
  }
  RTCRayHit8& query() { return query_; }
  [[nodiscard]] Hit hit(u32 i, const TracedScene& scene) const { return hit_of(query_, i, scene); }

 private:
  RTCRayHit8 query_;
};

/// True if rays may slip through an instance: the answers of other primitives are final.
bool slips(const SceneView& scene, u32 instance) {
  return scene.meshes[scene.instances[instance].mesh].shape == kernels::Shape::kTriangles;
}

/// By the watertight test; a ray of object space.
bool meet(const SceneView& scene, u32 instance, u32 primitive, const Ray& ray,
          kernels::TriangleHit& hit) {
  if (!slips(scene, instance)) return false;
  const kernels::MeshView& mesh = scene.meshes[scene.instances[instance].mesh];
  const uvec3 vertices = mesh.triangles[primitive];
  const auto at = [&](u32 vertex) { return kernels::vertex_at(mesh, vertex, ray.time); };
  const vec3 inverse = kernels::box_ray(ray.origin, ray.direction).inverse;
  return kernels::meet_triangle({at(vertices.x), 0, at(vertices.y), 0, at(vertices.z), 0},
                                ray.origin, ray.direction, kernels::across(ray.direction, inverse),
                                ray.t_max, hit);
}

Ray in_object(const SceneView& scene, u32 instance, Ray ray) {
  const kernels::ObjectRay local =
      kernels::moving_object_ray(scene, instance, ray.time, {ray.origin, ray.direction});
  ray.origin = local.origin;
  ray.direction = local.direction;
  return ray;
}

/// Findings of rays beside one: how many of them met something nearer, and what one of these
/// met.
struct Told {
  u32 nearer = 0;
  Hit other = kMiss;
};

/// Replaces `nearest` by what the ray meets of that.
Told look(const TracedScene& scene, const Ray& ray, u32 mask, vec2 first, Hit& nearest) {
  Beside beside(ray, mask, first);
  EmbreeTracer(scene).closest(beside.query(), kEvery, ray);
  const float before = nearest.t;
  Told told;
  for (u32 i = 0; i < kBeside; ++i) {
    const Hit seen = beside.hit(i, scene);
    if (!(seen.t < before) || !slips(*scene.view, seen.instance)) continue;
    if (seen.t < before * (1 - kernels::kUnclear)) {
      ++told.nearer;
      told.other = seen;
    }
    if (seen.instance == nearest.instance && seen.primitive == nearest.primitive) continue;
    Ray local = in_object(*scene.view, seen.instance, ray);
    local.t_max = std::min(ray.t_max, nearest.t);
    kernels::TriangleHit met;
    if (!meet(*scene.view, seen.instance, seen.primitive, local, met)) continue;
    const Hit hit{met.t, seen.instance, seen.primitive, met.u, met.v};
    if (!kernels::is_hole(*scene.view, ray.holes, hit) &&
        kernels::takes_over(*scene.view, ray, hit, nearest))
      nearest = hit;
  }
  return told;
}

}  // namespace

Hit look_again(const TracedScene& scene, const Ray& ray, u32 mask, const Hit& first) {
  if (!scene.top || !kernels::is_sound(ray)) return first;
  Hit nearest = first;
  // Triangles seen from the side are narrow, and those beside the ray may miss the one that it
  // meets: it is asked again, with others beside it. Where most of 32 met something, it does, too.
  Hit other = kMiss;
  bool is_closed = true;
  for (const vec2 aside :
       {vec2(1, 0), vec2(-0.4f, -1.3f), vec2(-0.03f, 0.08f), vec2(0.02f, -0.02f)}) {
    const Told told = look(scene, ray, mask, aside * kNearest, nearest);
    if (nearest.t != first.t || told.nearer < kSome) return nearest;
    is_closed &= told.nearer >= kMost;
    other = told.other;
  }
  return is_closed ? other : nearest;
}

bool meets_after_all(const TracedScene& scene, u32 instance, const Ray& ray_object) {
  if (!kernels::is_sound(ray_object, kernels::kFarthest, kernels::kFarthest)) return false;
  Beside beside(ray_object, kernels::kNone, {kNearest, 0});
  EmbreeTracer(scene).closest_in(instance, beside.query(), ray_object);
  for (u32 i = 0; i < kBeside; ++i) {
    const u32 primitive = beside.hit(i, scene).primitive;
    kernels::TriangleHit met;
    if (primitive == kernels::kNone || !meet(*scene.view, instance, primitive, ray_object, met))
      continue;
    if (!kernels::is_hole(*scene.view, ray_object.holes,
                          {met.t, instance, primitive, met.u, met.v}))
      return true;
  }
  return false;
}

}  // namespace heliograph::embree
