// A closed room whose walls emit and reflect: every path adds up to emission / (1 - albedo).
#include "renderer/schedule/engine.h"

#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

TEST_CASE("furnace: a closed room of albedo a and emission 1 - a has radiance 1 everywhere") {
  const float albedo = GENERATE(0.2f, 0.5f, 0.8f);
  const u32 roulette_depth = GENERATE(1u, 3u, kernels::kNone);
  auto engine = make_engine();
  PutMaterial wall;
  const auto set = [&](MaterialParameter p, float v) {
    wall.parameters[std::size_t(p)].value = vec3(v);
  };
  set(MaterialParameter::base_color, albedo);
  set(MaterialParameter::specular, 0);
  set(MaterialParameter::emission, 1 - albedo);
  wall.two_sided_emission = true;
  Edits edits;
  edits.mesh("sphere", sphere(16))
      .put("wall", wall)
      .object("room", "sphere", mat4x3(1), "wall")
      .camera("camera", look_at({0.3f, 0.2f, 0.1f}, vec3(1, 0, 0)), 8, 8, 6);
  auto job = job_of(edits.apply(), {Plane::BEAUTY}, 64);
  job.settings.max_depth = 200;
  job.settings.roulette_depth = roulette_depth;
  const auto frame = render(*engine, job);
  double mean = 0;
  for (std::size_t i = 0; i < 64; ++i) mean += double(pixels<float>(*frame)[4 * i]) / 64;
  CHECK(mean == Approx(1).margin(0.01));
}
