// Rays of the host through the BVH: eight at once meet what each of them meets alone, and every
// instruction set has the same answers.
#include <bit>

#include "renderer/bvh/host_tracer.h"
#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using host::RayPacket;

namespace {

/// Rays of one object's space towards its middle: nearly alike as a rule, from anywhere now and
/// then, along an axis, or too short to meet anything.
RayPacket random_packet(Random& random) {
  RayPacket packet{};
  packet.time = random.next();
  const auto towards = [&] {
    kernels::Ray ray = random_ray(random, 2);
    ray.direction = glm::normalize(random_vec3(random, 0.5f) - ray.origin);
    return ray;
  };
  kernels::Ray first = towards();
  const bool apart = random.next() < 0.2f, along = random.next() < 0.1f;
  if (along) first.direction = vec3(0, random.next() < 0.5f ? -1 : 1, 0);
  for (u32 i = 0; i < RayPacket::kRays; ++i) {
    kernels::Ray ray = apart ? towards() : first;
    if (!apart && !along) ray.direction += random_vec3(random, 0.05f);
    ray.origin += along ? vec3(0.05f * float(i), 0, 0) : random_vec3(random, 0.02f);
    ray.direction *= 0.1f + 5 * random.next();
    if (random.next() < 0.05f) ray.t_max = random.next() < 0.5f ? 0.0f : -1.0f;
    set_ray(packet, i, ray);
  }
  return packet;
}

std::vector<const bvh::RayFunctions*> levels() {
  std::vector<const bvh::RayFunctions*> levels{&bvh::kRaysV2};
  if (__builtin_cpu_supports("x86-64-v3")) levels.push_back(&bvh::kRaysV3);
  return levels;
}

}  // namespace

TEST_CASE("bvh packets: eight rays at once meet what each meets alone") {
  Random random(6);
  const BothScenes scenes(random_scene(random, {.count = 30, .holes = false, .curves = true}),
                          {0, 1});
  for (const bvh::RayFunctions* level : levels()) {
    const bvh::BvhHostTracer tracer(scenes.own(), *level);
    constexpr u32 kPackets = 50'000;
    u32 wrong = 0, asked = 0, met = 0;
    for (u32 i = 0; i < kPackets; ++i) {
      const RayPacket packet = random_packet(random);
      const u32 instance = i % scenes.view().instance_count;
      const u32 lanes = random.next() < 0.5f ? 0xffu : u32(random.next() * 256);
      const u32 alone = tracer.HostTracer::meets_of(instance, packet, lanes);
      wrong += tracer.meets_of(instance, packet, lanes) != alone;
      asked += u32(std::popcount(lanes));
      met += u32(std::popcount(alone));
    }
    CHECK(wrong == 0);
    INFO(met << " of " << asked);
    CHECK((met > asked / 10 && met < asked / 10 * 9));
  }
}

TEST_CASE("bvh rays: the same bits for every instruction set") {
  Random random(7);
  const BothScenes scenes(random_scene(random, {.count = 30, .fixed = true, .curves = true}),
                          {0, 1}, 1'000'000);
  REQUIRE(scenes.bvh_view().fixed.nodes);
  const kernels::BvhTracerFor<kernels::Answers::kLabels> kernel(scenes.view(), scenes.bvh_view());
  for (const bvh::RayFunctions* level : levels()) {
    const bvh::BvhHostTracer tracer(scenes.own(), *level);
    u32 wrong = 0, met = 0;
    for (u32 i = 0; i < 100'000; ++i) {
      const kernels::Ray ray = random_ray(random, 12);
      const u32 instance = i % scenes.view().instance_count;
      const auto same = [](const kernels::Hit& a, const kernels::Hit& b) {
        return a.t == b.t && a.instance == b.instance && a.primitive == b.primitive && a.u == b.u &&
               a.v == b.v;
      };
      const kernels::Hit hit = kernel.closest(ray, kernels::kAllRays);
      wrong += !same(hit, tracer.closest(ray, kernels::kAllRays));
      wrong += kernel.occluded(ray, kernels::kAllRays) != tracer.occluded(ray, kernels::kAllRays);
      wrong += !same(kernel.closest_in(instance, ray), tracer.closest_in(instance, ray));
      met += hit.instance != kNone;
    }
    CHECK(wrong == 0);
    CHECK(met > 10'000);
  }
}
