// No ray leaves a closed mesh between its triangles: rays from within at points on their edges.
#include "renderer/backend/embree/host_tracer.h"
#include "renderer/backend/embree/room.h"
#include "renderer/bvh/host_tracer.h"
#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

/// A ball whose vertices lie somewhere between half and the whole of its radius from the middle.
Shape crumpled_ball(Random& random, u32 n) {
  Shape ball = sphere(n);
  const u32 row = 2 * n + 1;
  for (u32 i = 0; i <= n; ++i)
    for (u32 j = 0; j <= 2 * n; ++j) {
      vec3& p = ball.positions[i * row + j];
      // The seam and the poles have several vertices at one place.
      if (j == 2 * n)
        p = ball.positions[i * row];
      else if (i == 0 || i == n)
        p = vec3(0, 0, i == 0 ? 1 : -1);
      else
        p *= 0.5f + 0.5f * random.next();
    }
  return ball;
}

struct Closed {
  const char* name;
  Shape shape;
};
std::vector<Closed> closed_meshes(Random& random) {
  return {
      {"cube", cube()}, {"coarse", crumpled_ball(random, 4)}, {"fine", crumpled_ball(random, 60)}};
}

/// Rays from about the middle of one instance to points on the edges of its triangles.
class ToEdges {
 public:
  ToEdges(Random& random, const kernels::SceneView& scene) : random_(random), scene_(scene) {}
  /// aside   how far from the edge the point may be, of the triangle
  kernels::Ray next(float aside = 0) {
    const kernels::MeshView& mesh = scene_.meshes[scene_.instances[0].mesh];
    const uvec3 triangle = mesh.triangles[random_below(random_, mesh.triangle_count)];
    const int k = int(random_below(random_, 3));
    const vec3 a = mesh.positions[triangle[k]], b = mesh.positions[triangle[(k + 1) % 3]];
    const vec3 c = mesh.positions[triangle[(k + 2) % 3]];
    const vec3 on_edge = glm::mix(a, b, random_.next());
    const mat4x3& pose = scene_.instances[0].world_from_object;
    kernels::Ray ray{};
    ray.t_max = INFINITY;
    ray.origin = kernels::transform_point(pose, random_vec3(random_, 0.1f));
    const vec3 to = kernels::transform_point(pose, glm::mix(on_edge, c, aside * random_.next()));
    ray.direction = glm::normalize(to - ray.origin);
    return ray;
  }

 private:
  Random& random_;
  const kernels::SceneView& scene_;
};

template <class Closest>
u32 leaks(ToEdges rays, u32 count, const Closest& closest) {
  u32 out = 0;
  for (u32 i = 0; i < count; ++i) out += closest(rays.next()).instance == kNone;
  return out;
}

}  // namespace

TEST_CASE("watertight: no ray leaves a closed mesh") {
  Random random(4);
  constexpr u32 kRays = 80'000;
  u32 slipped = 0;
  for (const Closed& closed : closed_meshes(random))
    for (const bool fixed : {false, true})
      for (const float size : {1e-3f, 1.0f, 1e3f}) {
        INFO(closed.name << ", " << size << " m" << (fixed ? ", static" : ""));
        PutEntity still;
        still.is_static = fixed;
        const BothScenes scenes(Edits()
                                    .mesh("closed", closed.shape)
                                    .object("closed", "closed", random_pose(random, 3 * size, size))
                                    .put("closed", still)
                                    .apply(),
                                {0, 0}, fixed ? 1'000'000 : 0);
        const ToEdges rays(random, scenes.view());
        const auto of = [](const auto& tracer) {
          return
              [&tracer](const kernels::Ray& ray) { return tracer.closest(ray, kernels::kAllRays); };
        };
        CHECK(leaks(rays, kRays, of(scenes.bvh())) == 0);
        slipped += leaks(rays, kRays, of(scenes.embree()));
        CHECK(leaks(rays, kRays, of(scenes.embree(embree::kAlwaysAgain))) == 0);
        kernels::CameraView camera{};
        camera.world_from_camera = scenes.view().instances[0].world_from_object;
        const embree::SecondLook room = embree::second_look(embree::traced(scenes.other()), camera);
        CHECK(room.of == embree::SecondLook::Of::kRaysOut);
        CHECK(leaks(rays, kRays, of(scenes.embree(room))) == 0);
      }
  CHECK(slipped > 100);  // the rays are such that one look is not enough
}

TEST_CASE("watertight: no ray passes an instance that it meets alone") {
  Random random(5);
  for (const Closed& closed : closed_meshes(random)) {
    INFO(closed.name);
    const BothScenes scenes(
        Edits().mesh("closed", closed.shape).object("closed", "closed", mat4x3(1)).apply(), {0, 0});
    ToEdges rays(random, scenes.view());
    const bvh::BvhHostTracer own(scenes.own());
    const embree::EmbreeHostTracer embree(embree::traced(scenes.other()));
    u32 missed[4]{};
    for (u32 i = 0; i < 30'000; ++i) {
      host::RayPacket packet{};
      for (u32 lane = 0; lane < host::RayPacket::kRays; ++lane) {
        kernels::Ray ray = rays.next(lane == i % host::RayPacket::kRays ? 0 : 0.5f);
        ray.direction *= 0.1f + random.next();
        missed[0] += !own.meets(0, ray);
        missed[1] += !embree.meets(0, ray);
        set_ray(packet, lane, ray);
      }
      missed[2] += own.meets_of(0, packet, 0xff) != 0xff;
      missed[3] += embree.meets_of(0, packet, 0xff) != 0xff;
    }
    CHECK(missed[0] == 0);
    CHECK(missed[1] == 0);
    CHECK(missed[2] == 0);
    CHECK(missed[3] == 0);
  }
}
