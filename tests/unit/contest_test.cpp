// Surfaces at one place: every label takes the same one of them, and pictures' speckles are not
// those of the labels.
#include "renderer/backend/embree/host_tracer.h"
#include "renderer/bvh/host_tracer.h"
#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

/// A unit square of n by n squares about the origin, whose vertices between its corners lie as
/// rounding has them.
Shape grid(u32 n) {
  Shape shape;
  for (u32 i = 0; i <= n; ++i)
    for (u32 j = 0; j <= n; ++j) {
      const vec2 at(float(j) / float(n), float(i) / float(n));
      shape.positions.push_back(vec3(at - 0.5f, 0));
      shape.uvs.push_back(at);
    }
  for (u32 i = 0; i < n; ++i)
    for (u32 j = 0; j < n; ++j) {
      const u32 a = i * (n + 1) + j, b = a + n + 1;
      shape.triangles.push_back({a, a + 1, b});
      shape.triangles.push_back({a + 1, b + 1, b});
    }
  return shape;
}

mat4x3 raised(const mat4x3& pose, float by, float size) {
  mat4x3 out = pose;
  out[0] *= size;
  out[1] *= size;
  out[3] += pose[2] * by;
  return out;
}

/// How many of the rays to the smaller of two surfaces take the one of a label.
template <class T>
u32 taken(Random random, const T& tracer, const kernels::SceneView& scene, const mat4x3& pose,
          u32 count, u32 label) {
  u32 out = 0;
  for (u32 i = 0; i < count; ++i) {
    kernels::Ray ray{};
    ray.t_max = INFINITY;
    ray.holes.probe = true;
    ray.origin = pose * vec4(random_vec3(random, 5) + vec3(0, 0, 7), 1);
    const vec3 to = pose * vec4((random.next2() - 0.5f) * 1.9f, 0, 1);
    ray.direction = glm::normalize(to - ray.origin);
    const kernels::Hit hit = tracer.closest(ray, kernels::kAllRays);
    out += hit.instance != kNone && scene.instances[hit.instance].label == label;
  }
  return out;
}

}  // namespace

TEST_CASE("contest: of surfaces at one place labels take the smallest label") {
  Random random(8);
  constexpr u32 kRays = 20'000;
  for (int k = 0; k < 12; ++k) {
    const mat4x3 pose = random_pose(random, 3, 1);
    // First and last on one plane; the second of them lies in front by 1e-5 of its distance in the
    // other half of the scenes.
    const bool apart = k % 2 == 1;
    const BothScenes scenes(Edits()
                                .mesh("coarse", quad())
                                .mesh("fine", grid(7))
                                .object("wall", k % 4 < 2 ? "coarse" : "fine", raised(pose, 0, 4))
                                .object("decal", "fine", raised(pose, apart ? 2e-4f : 0, 2))
                                .apply(),
                            {0, 0}, k % 3 == 0 ? 1'000'000 : 0);
    const u32 wall = std::min(scenes.view().instances[0].label, scenes.view().instances[1].label);
    const u32 wanted = apart ? wall + 1 : wall;
    const kernels::BvhTracerFor<kernels::Answers::kLabels> own(scenes.view(), scenes.bvh_view());
    INFO("scene " << k);
    CHECK(taken(random, own, scenes.view(), pose, kRays, wanted) == kRays);
    CHECK(taken(random, scenes.embree(embree::kAlwaysAgain), scenes.view(), pose, kRays, wanted) ==
          kRays);
    if (!apart)  // the scenes are such that it matters
      CHECK(taken(random, scenes.embree(), scenes.view(), pose, kRays, wall) < kRays);
  }
}
