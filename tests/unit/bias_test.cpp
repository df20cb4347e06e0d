// What darkens a picture to calm it, and is off unless asked for: clamps and regularisation.
#include "kernels/schedule/scalar.h"

#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::test;

TEST_CASE("bias: clamping bounds each contribution, and only when asked") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(1, 1)), scene.add(emitter(vec3(100, 50, 0))));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0, 0, 3}, {0, 0, 0}, {1, 1}, 0.1f);
  Settings settings = standard_settings(1);
  CHECK(mean_beauty(view, camera, settings, 4).x == 100);
  settings.clamp = 10;
  const vec3 got = mean_beauty(view, camera, settings, 4);
  CHECK(got.x == Approx(10));
  CHECK(got.y == Approx(5));
}

TEST_CASE("bias: clamp_indirect leaves emission and direct light as they are") {
  TestScene scene;
  MaterialView glowing = lambert(vec3(0.5f));
  glowing.constant.emission = vec3(1);
  glowing.two_sided_emission = true;
  scene.add_light(scene.add_instance(scene.add(sphere(16)), scene.add(glowing)));
  const SceneView& view = scene.finish();
  const CameraView camera = look_at({0, 0, 0}, {1, 0, 0}, {2, 2}, 0.5f);
  Settings settings = standard_settings(20);
  CHECK(mean_beauty(view, camera, settings, 1024).y == Approx(2).epsilon(0.02));  // 1 / (1 - 0.5)
  settings.clamp_indirect = 1e-6f;
  CHECK(mean_beauty(view, camera, settings, 1024).y == Approx(1.5f).epsilon(0.02));
}

TEST_CASE("bias: regularization calms caustics and leaves what is seen directly") {
  TestScene scene;
  scene.add_instance(scene.add(rectangle(4, 4)), scene.add(lambert(vec3(0.5f))));
  MaterialView metal = standard_material();
  metal.constant.metallic = 1;
  metal.constant.roughness = 0.1f;
  scene.add_instance(scene.add(sphere(32)), scene.add(metal), pose(mat3(0.5f), {1, 0, 0.5f}));
  scene.add_light(scene.add_instance(scene.add(sphere(16)), scene.add(emitter(vec3(2000))),
                                     pose(mat3(0.02f), {0, 0, 2})));
  const SceneView& view = scene.finish();
  // Mean and variance of a sample, over pixels of the floor beside the ball, or of the ball.
  const auto look = [&](vec3 at, bool regularize) {
    Settings settings = standard_settings(4);
    settings.regularize = regularize;
    const CameraView camera = look_at({-2, 0, 2}, at, {8, 8}, 0.1f);
    const TestTracer tracer(view);
    const TestFilm film({8, 8}, kBeauty);
    PixelStatistics sum{0, 0};
    for (u32 i = 0; i < 64; ++i) {
      render_pixel(view, camera, settings, tracer, film.view, i % 8, i / 8, 0, 1024);
      const PixelStatistics s = pixel_statistics(film.view, i, 1024);
      sum = {sum.mean + s.mean / 64, sum.variance + s.variance * 1024 / 64};
    }
    return sum;
  };
  const PixelStatistics sharp = look({0.2f, 0, 0}, false), soft = look({0.2f, 0, 0}, true);
  INFO("mean " << sharp.mean << " to " << soft.mean << ", variance " << sharp.variance << " to "
               << soft.variance);
  CHECK(soft.variance < sharp.variance / 2);
  CHECK(soft.mean == Approx(sharp.mean).epsilon(0.3));
  const vec3 on_metal(0.6f, 0, 0.8f);
  CHECK(look(on_metal, true).mean == Approx(look(on_metal, false).mean).epsilon(0.05));
}
