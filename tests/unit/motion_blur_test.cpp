// Pictures of what moves while the shutter is open, against closed forms.
#include <numeric>

#include "renderer/frame/motion_keys.h"
#include "renderer/schedule/engine.h"
#include "tests/unit/random.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

constexpr double kNoise = 0.012;  // of 1024 samples over a pixel and the time, six deviations

/// An orthographic camera over the XY plane: pixel (x, y) of n x n covers 1 / scale metres, row 0
/// at the largest y.
Edits& from_above(Edits& edits, u32 n, double scale, Shutter shutter) {
  PutEntity entity;
  entity.pose = PosePatch{{}, {translation({0, 0, 5})}};
  entity.camera = Camera{.width = n,
                         .height = n,
                         .projection = Projection::kOrthographic,
                         .fx = scale,
                         .fy = scale,
                         .cx = n / 2.0 - 0.5,
                         .cy = n / 2.0 - 0.5,
                         .shutter = shutter};
  return edits.put("camera", entity);
}

/// A surface that shows white.
Edits& white(Edits& edits) {
  PutMaterial material;
  material.unlit = true;
  material.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(1);
  return edits.put("white", material);
}

Edits& keyed(Edits& edits, const std::string& name, std::vector<Time> times,
             std::vector<mat4x3> matrices) {
  PutEntity entity;
  entity.pose = PosePatch{std::move(times), std::move(matrices)};
  return edits.put(name, entity);
}

mat4x3 turned(float angle, vec3 at = vec3(0)) {
  const float c = std::cos(angle), s = std::sin(angle);
  return {{c, s, 0}, {-s, c, 0}, {0, 0, 1}, at};
}

float red(const Frame& frame, u32 x, u32 y, std::size_t plane = 0) {
  return pixels<float>(frame, plane)[4 * (u64(y) * frame.width + x)];
}

/// A square of `side` metres whose centre goes along x from `from` to `to` in one second.
std::shared_ptr<const Snapshot> moving_square(float from, float to, Shutter shutter) {
  Edits edits;
  white(edits).mesh("quad", quad()).object("square", "quad", scaled(vec3(1), vec3(0)), "white");
  keyed(edits, "square", {0, 1}, {translation({from, 0, 0}), translation({to, 0, 0})});
  return from_above(edits, 64, 16, shutter).apply();
}

}  // namespace

TEST_CASE("motion: the profile of a moving square is the convolution of two boxes") {
  auto engine = make_engine();
  // 16 pixels wide, moving by 24 pixels; of the shutter's time only half lies within the motion.
  const Shutter shutter{-0.25, 0.75, 0};
  const auto scene = moving_square(-0.75f, 0.75f, shutter);
  const auto frame = render(*engine, job_of(scene, {Plane::BEAUTY}, 1024));
  for (u32 x = 0; x < 64; ++x) {
    constexpr int kSteps = 20000;
    double expected = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double t = -0.25 + (i + 0.5) / kSteps;
      const double left = 32 + 16 * (-0.75 + 1.5 * std::clamp(t, 0.0, 1.0)) - 8;
      expected += std::clamp(std::min(left + 16, x + 1.0) - std::max(left, double(x)), 0.0, 1.0);
    }
    INFO("x " << x);
    CHECK(double(red(*frame, x, 32)) == Approx(expected / kSteps).margin(kNoise));
  }
  CHECK(red(*frame, 32, 10) == 0);
}

TEST_CASE("motion: a bar that turns by 350 degrees follows the arc") {
  constexpr float kWidth = 0.05f, kTurn = 350 * float(M_PI) / 180;
  Edits edits;
  white(edits).mesh("quad", quad());
  edits.object("pivot", "quad", scaled(vec3(1e-3f), vec3(0)));
  edits.object("bar", "quad", scaled({1, kWidth, 1}, {0.8f, 0, 0}), "white");
  PutEntity child;
  child.parent = Ref("pivot");
  child.pose = PosePatch{{}, {scaled({0.5f, kWidth, 1}, {0.75f, 0, 0})}};
  edits.put("bar", child);
  std::vector<Time> times;
  std::vector<mat4x3> poses;
  for (int i = 0; i <= 7; ++i) {
    times.push_back(i / 7.0);
    poses.push_back(turned(kTurn * float(i) / 7));
  }
  keyed(edits, "pivot", times, poses);
  auto engine = make_engine();
  constexpr u32 kSize = 128;
  const auto frame = render(
      *engine, job_of(from_above(edits, kSize, 60, {0, 1, 0}).apply(), {Plane::BEAUTY}, 1024));
  // A point at radius r is covered while the bar's axis is within asin(width / 2 r) of its angle.
  double worst = 0;
  for (u32 y = 0; y < kSize; ++y)
    for (u32 x = 0; x < kSize; ++x) {
      const double px = (x + 0.5 - kSize / 2.0) / 60, py = (kSize / 2.0 - y - 0.5) / 60;
      const double r = std::hypot(px, py);
      double angle = std::atan2(py, px);
      if (angle < 0) angle += 2 * M_PI;
      if (r < 0.55 || r > 0.95) continue;
      const double reach = std::asin(double(kWidth) / 2 / r), margin = 0.03;
      if (angle > reach + margin && angle < double(kTurn) - reach - margin)
        worst = std::max(worst, std::abs(double(red(*frame, x, y)) - 2 * reach / double(kTurn)));
      else if (angle > double(kTurn) + reach + margin && angle < 2 * M_PI - reach - margin)
        CHECK(red(*frame, x, y) == 0);
    }
  CHECK(worst < kNoise);
}

TEST_CASE("motion: a camera that moves sees what it would if all else moved the other way") {
  const auto make = [](bool camera_moves) {
    Edits edits = still_life();
    const mat4x3 eye = look_at({4, -4, 3}, {0, 0, 0.4f});
    std::vector<mat4x3> poses;
    for (const float u : {0.0f, 0.5f, 1.0f}) poses.push_back(turned(0.3f * u, {0.2f * u, 0, 0.1f}));
    for (mat4x3& pose : poses) pose = camera_moves ? pose : inverse(pose);
    for (const char* name : {"floor", "box", "ball", "lamp"}) {
      PutEntity child;
      child.parent = Ref("world");
      edits.put(name, child);
    }
    Edits first;
    first.put("world", PutEntity{});
    if (!camera_moves) keyed(first, "world", {0, 0.5, 1}, poses);
    if (camera_moves) {
      std::vector<mat4x3> eyes;
      for (const mat4x3& pose : poses) eyes.push_back(multiply(pose, eye));
      keyed(edits, "camera", {0, 0.5, 1}, eyes);
    }
    auto scene = edits.apply(*first.apply());
    PutEntity shutter;
    shutter.camera = *scene->find(entity(*scene, "camera"))->camera;
    shutter.camera->value().shutter = {0, 1, 0};
    return Edits().put("camera", shutter).apply(*scene);
  };
  auto engine = make_engine();
  const auto a = render(*engine, job_of(make(true), {Plane::COVERAGE, Plane::BEAUTY}, 256));
  const auto b = render(*engine, job_of(make(false), {Plane::COVERAGE, Plane::BEAUTY}, 256));
  double difference = 0, light = 0;
  for (std::size_t i = 0; i < pixels<float>(*a).size(); ++i)
    CHECK(pixels<float>(*a)[i] == Approx(pixels<float>(*b)[i]).margin(0.06));
  for (std::size_t i = 0; i < pixels<float>(*a, 1).size(); ++i) {
    difference += double(pixels<float>(*a, 1)[i] - pixels<float>(*b, 1)[i]);
    light += double(pixels<float>(*a, 1)[i]);
  }
  CHECK(std::abs(difference) < 2e-3 * light);
}

TEST_CASE("motion: a square whose vertices spread blurs at its edges") {
  auto topology = std::make_shared<MeshTopology>();
  topology->vertex_count = 4;
  topology->triangles = ArrayOf(quad().triangles);
  std::vector<vec3> positions;
  for (const float side : {1.0f, 2.0f})
    for (const vec3 p : quad().positions) positions.push_back(p * side);
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0, 1};
  vertices->positions = ArrayOf(std::move(positions));
  Edits edits;
  white(edits).put("mesh", PutMesh{topology, vertices});
  edits.object("square", "mesh", mat4x3(1), "white");
  auto engine = make_engine();
  const auto frame =
      render(*engine, job_of(from_above(edits, 48, 16, {0, 1, 0}).apply(), {Plane::BEAUTY}, 1024));
  for (u32 x = 24; x < 48; ++x) {
    // Its half side is 8 + 8 t pixels: a pixel is open for a share of the time.
    const auto covered = [](double from) { return std::clamp(2 - from / 8, 0.0, 1.0); };
    double expected = 0;
    for (int i = 0; i < 64; ++i) expected += covered(x - 24 + (i + 0.5) / 64) / 64;
    CHECK(double(red(*frame, x, 24)) == Approx(expected).margin(kNoise));
  }
}

TEST_CASE("motion: what stands still has the same bytes whatever the shutter") {
  auto engine = make_engine();
  const auto still = still_life().apply();
  PutEntity shutter;
  shutter.camera = *still->find(entity(*still, "camera"))->camera;
  shutter.camera->value().shutter = {-0.5, 0.5, 0.25};
  const auto open = Edits().put("camera", shutter).apply(*still);
  const std::vector planes{Plane::BEAUTY, Plane::DEPTH, Plane::INSTANCE, Plane::POSITION};
  CHECK(same_planes(*render(*engine, job_of(still, planes, 16)),
                    *render(*engine, job_of(open, planes, 16))));
}

TEST_CASE("motion: beauty_still is the beauty of a closed shutter at the label time") {
  auto engine = make_engine();
  auto job =
      job_of(moving_square(-0.75f, 0.75f, {0, 1, 0}), {Plane::BEAUTY, Plane::BEAUTY_STILL}, 32);
  job.label_time = 0.25;
  const auto both = render(*engine, job);
  auto closed = job_of(moving_square(-0.75f, 0.75f, {}), {Plane::BEAUTY}, 32);
  closed.time = 0.25;
  const auto sharp = render(*engine, closed);
  CHECK(both->planes[1].pixels == sharp->planes[0].pixels);
  CHECK(both->planes[0].pixels != sharp->planes[0].pixels);
  auto alone = job;
  alone.planes = {Plane::BEAUTY_STILL};
  CHECK(render(*engine, alone)->planes[0].pixels == sharp->planes[0].pixels);
}

TEST_CASE("motion: the same bits with one thread, two, and any split of the work") {
  Edits edits = still_life();
  keyed(edits, "ball", {0, 1},
        {scaled(vec3(0.5f), {-0.6f, -0.2f, 0.5f}), turned(2, {0.3f, -1, 1})});
  keyed(
      edits, "lamp", {0, 1},
      {mat4x3(1, 0, 0, 0, -1, 0, 0, 0, -1, 0, 0, 3), mat4x3(1, 0, 0, 0, -1, 0, 0, 0, -1, 1, 0, 3)});
  auto scene = edits.apply();
  PutEntity shutter;
  shutter.camera = *scene->find(entity(*scene, "camera"))->camera;
  shutter.camera->value().shutter = {0, 0.75, 0.25};
  scene = Edits().put("camera", shutter).apply(*scene);
  const std::vector planes{Plane::BEAUTY, Plane::BEAUTY_STILL, Plane::DEPTH, Plane::INSTANCE};
  auto two = make_engine(2), one = make_engine(1);
  const auto reference = render(*two, job_of(scene, planes, 21));
  CHECK(same_planes(*reference, *render(*one, job_of(scene, planes, 21))));
  auto fine = Engine::create({.device = {.threads = 2}, .slice = std::chrono::milliseconds(1)});
  REQUIRE(fine.has_value());
  CHECK(same_planes(*reference, *render(**fine, job_of(scene, planes, 21))));
}

TEST_CASE("motion: rows of a rolling shutter are seen at their own times") {
  auto engine = make_engine();
  constexpr double kRolling = 0.5;
  const auto scene = moving_square(-0.75f, 0.75f, {0, 0, kRolling});
  auto job = job_of(scene, {Plane::INSTANCE, Plane::POSITION}, 0);
  job.time = 0.25;
  job.labels.boxes = job.labels.amodal_masks = job.labels.amodal = true;
  const auto frame = render(*engine, job);
  for (u32 y = 16; y < 48; ++y) {
    const double t = 0.25 + kRolling * y / 63.0;
    const double left = 32 + 16 * (-0.75 + 1.5 * t) - 8;
    for (u32 x = 0; x < 64; ++x) {
      const double inside = std::min(x + 0.5 - left, left + 16 - x - 0.5);
      if (std::abs(inside) < 1e-3) continue;
      INFO(x << ", " << y);
      CHECK((pixels<u32>(*frame)[y * 64 + x] != 0) == (inside > 0 && y >= 24 && y < 40));
      if (inside <= 0 || y < 24 || y >= 40) continue;
      // What Embree met and what kernels say of it agree.
      const float* p = &pixels<float>(*frame, 1)[3 * (y * 64 + x)];
      CHECK(double(p[0]) * 16 + 32 == Approx(x + 0.5).margin(1e-3));
    }
  }
  const auto column = [&](const char* name) -> const Column& {
    for (const Column& c : frame->labels)
      if (c.name == name) return c;
    FAIL("no column " << name);
    return frame->labels[0];
  };
  const auto* pose = reinterpret_cast<const double*>(column("world_from_object").data.data());
  CHECK(pose[3] == Approx(-0.75 + 1.5 * (0.25 + kRolling / 2)).margin(1e-6));
  const auto* seen = reinterpret_cast<const u32*>(column("visible").data.data());
  const auto* inside = reinterpret_cast<const u32*>(column("inside").data.data());
  CHECK(*seen == *inside);
  CHECK(column("bbox_visible").data == column("bbox_amodal").data);
}

TEST_CASE("motion: Embree and the kernels put a turning object in the same place") {
  Random random;
  auto engine = make_engine();
  for (int round = 0; round < 20; ++round) {
    const auto uniform = [&] { return 2 * random.next() - 1; };
    std::vector<mat4x3> poses;
    glm::quat q = glm::normalize(glm::quat(uniform(), uniform(), uniform(), uniform()));
    for (int i = 0; i < 5; ++i) {
      const vec3 axis = glm::normalize(vec3(uniform(), uniform(), uniform()));
      q = glm::angleAxis(random.next(), axis) * q;
      mat3 linear = glm::mat3_cast(q);
      linear[0] *= 1.5f + 0.5f * random.next();
      linear[1] += 0.3f * linear[0];
      poses.push_back({linear[0], linear[1], linear[2], 0.2f * vec3(uniform(), uniform(), 0)});
    }
    Edits edits;
    edits.mesh("cube", cube()).object("box", "cube", mat4x3(1));
    keyed(edits, "box", {0, 0.25, 0.5, 0.75, 1}, poses);
    const auto scene = from_above(edits, 128, 50, {0, 0, 1}).apply();
    const auto frame = render(*engine, job_of(scene, {Plane::POSITION}));
    float worst = 0;
    for (u32 y = 0; y < 128; ++y)
      for (u32 x = 0; x < 128; ++x) {
        const float* p = &pixels<float>(*frame)[3 * (y * 128 + x)];
        if (std::isnan(p[0])) continue;
        worst = std::max(worst, std::abs(p[0] * 50 + 64 - float(x) - 0.5f));
        worst = std::max(worst, std::abs(64 - p[1] * 50 - float(y) - 0.5f));
      }
    INFO("round " << round);
    CHECK(worst < 2e-3f);
  }
}

TEST_CASE("motion: a lamp that moves lights as it does on the average of its way") {
  // A small square lamp above a grey floor, whose direct light is seen at the origin.
  const auto scene_of = [](Shutter shutter, bool turns) {
    Light light;
    light.intensity = 50;
    Edits edits;
    PutMaterial matte;
    matte.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(0.5f);
    matte.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
    edits.put("grey", matte).mesh("quad", quad());
    edits.object("floor", "quad", scaled(vec3(0.2f), vec3(0)), "grey");
    edits.object("lamp", "quad", mat4x3(1), "grey").light("lamp", light);
    PutEntity hidden;
    hidden.visibility = u8(kAllRays & ~kCameraRay);
    edits.put("lamp", hidden);
    std::vector<mat4x3> poses;
    for (const float u : {-1.0f, 0.0f, 1.0f}) {
      const float tilt = turns ? 0.5f * u : 0;
      const float c = 0.1f * std::cos(tilt), s = 0.1f * std::sin(tilt);
      poses.push_back({{-c, 0, -s}, {0, 0.1f, 0}, {s, 0, -c}, {2 * u, 0, 1}});
    }
    keyed(edits, "lamp", {0, 0.5, 1}, poses);
    return from_above(edits, 4, 100, shutter).apply();
  };
  for (const bool turns : {false, true}) {
    auto engine = make_engine();
    auto job = job_of(scene_of({0, 1, 0}, turns), {Plane::BEAUTY}, 4096);
    job.settings.max_depth = 2;
    const auto frame = render(*engine, job);
    double mean = 0, expected = 0;
    for (u32 i = 0; i < 16; ++i) mean += double(red(*frame, i % 4, i / 4)) / 16;
    constexpr int kSteps = 2000;
    for (int i = 0; i < kSteps; ++i) {
      const double u = -1 + 2 * (i + 0.5) / kSteps, x = 2 * u, d2 = x * x + 1, d = std::sqrt(d2);
      const double tilt = turns ? 0.5 * u : 0;
      // The front's normal is (sin, 0, -cos); the lamp looks down, tilted.
      const double emitted = (-x * std::sin(tilt) + std::cos(tilt)) / d;
      expected += 0.5 / M_PI * 50 * 0.01 * std::max(emitted, 0.0) * (1 / d) / d2 / kSteps;
    }
    INFO("turns " << turns);
    CHECK(mean == Approx(expected).epsilon(0.01));
  }
}

TEST_CASE("motion: frames of many times keep no more than a few scenes") {
  auto engine = make_engine();
  const auto scene = moving_square(-0.75f, 0.75f, {0, 1e-3, 0});
  u64 early = 0;
  for (int i = 0; i < 1000; ++i) {
    auto job = job_of(scene, {Plane::BEAUTY}, 1);
    job.time = i * 1e-3;
    job.width = job.height = 4;
    (void)render(*engine, job);
    if (i == 100) early = engine->derived_bytes();
  }
  CHECK(engine->derived_bytes() <= early + 4096);
}
