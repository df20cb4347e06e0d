// A room with all that paths do, and the loop over its pixels, which other ways of running the path
// tracer are held against.
#pragma once

#include "kernels/schedule/wave.h"
#include "tests/unit/random.h"
#include "tests/unit/test_tracer.h"

namespace heliograph::test {

inline constexpr uvec2 kSize{20, 18};  // the last tiles are cut
inline constexpr u32 kSamples = 20;    // more than a block

inline MaterialView plastic(float roughness, float transmission = 0) {
  MaterialView m = standard_material();
  m.constant.base_color = vec3(0.7f, 0.5f, 0.3f);
  m.constant.roughness = roughness;
  m.constant.transmission = transmission;
  return m;
}

/// A room with a lamp, a glossy floor, two spheres and a dome; the second sphere may hold a medium.
inline const SceneView& furnish(TestScene& scene, bool fog) {
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(plastic(0.3f)),
                     pose(mat3(1), {0, 0, -1}));
  scene.add_instance(scene.add(sphere(16)), scene.add(plastic(0.1f)));
  MaterialView glass = plastic(0.05f, 1);
  if (fog) {
    glass.constant.medium_density = vec3(1);
    glass.constant.medium_albedo = vec3(0.8f, 0.6f, 0.9f);
  }
  scene.add_instance(scene.add(sphere(16)), scene.add(glass), pose(mat3(1), {1.5f, -1, 0}));
  scene.add_light(scene.add_instance(scene.add(rectangle(1.5f, 1.5f)),
                                     scene.add(emitter(vec3(4, 5, 6))),
                                     pose(rotation({1, 0, 0}, kPi), {0.5f, 0.3f, 3})));
  std::vector<float> texels(size_t(16) * 8 * 3, 0.3f);
  texels[40] = 20;
  scene.set_dome(vec3(1), scene.add_texture(texels, {16, 8}, TexelType::kF32));
  return scene.finish();
}

struct Picture {
  ShotView shot;
  const TestTracer& tracer;
};

inline u64 run_loop(const Picture& picture, const TestFilm& film) {
  const auto& [scene, camera, settings, own] = picture.shot;
  u64 rays = 0;
  for (u32 y = 0; y < kSize.y; ++y)
    for (u32 x = 0; x < kSize.x; ++x)
      rays += render_pixel(scene, camera, settings, picture.tracer, film.view, x, y, 0, kSamples);
  return rays;
}

inline ShotView shot_of(const SceneView& scene, u64 seed, const TestFilm& film) {
  Settings settings = standard_settings(seed);
  settings.roulette_depth = 3;
  settings.clamp_indirect = 3;
  const vec3 eye(3, -3 + 0.1f * float(seed), 2);
  return {scene, look_at(eye, {0, 0, -0.2f}, kSize, 0.8f), settings, film.view};
}

inline constexpr PlaneSet kEverything =
    kBeauty | kLightPlaneSet | kGuidePlaneSet | plane_bit(Plane::BEAUTY_GROUP) |
    plane_bit(Plane::COVERAGE) | plane_bit(Plane::AMBIENT_OCCLUSION) | plane_bit(Plane::COST);

}  // namespace heliograph::test
