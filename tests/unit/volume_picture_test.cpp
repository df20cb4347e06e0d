// Pictures of volumes against closed forms and quadrature, their labels against arithmetic.
#include "kernels/media/phase.h"
#include "renderer/derived/black_body.h"
#include "tests/unit/random_grid.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

std::shared_ptr<const Grid> box_grid(const std::vector<float>& values, ivec3 size,
                                     mat4x3 object_from_voxel = mat4x3(1)) {
  Grid grid = dense_grid(values, size, 1);
  grid.object_from_voxel = object_from_voxel;
  return std::make_shared<const Grid>(std::move(grid));
}
/// A cube of side 2 about the origin, of one density.
std::shared_ptr<const Grid> cube_grid(float density) {
  return box_grid({density}, ivec3(1), scaled(vec3(2), vec3(-1)));
}
PutEntity showing_volume(const std::string& volume, const mat4x3& pose = mat4x3(1)) {
  return {.pose = PosePatch{{}, {pose}}, .volume = Ref(volume)};
}
/// Parallel rays along -z from z = 10 over a square of side 1 about the origin.
Edits& parallel_camera(Edits& edits, u32 size = 4) {
  const double c = size / 2.0 - 0.5;
  PutEntity camera{.pose = PosePatch{{}, {translation({0, 0, 10})}}};
  camera.camera = Camera{.width = size,
                         .height = size,
                         .projection = Projection::kOrthographic,
                         .fx = double(size),
                         .fy = double(size),
                         .cx = c,
                         .cy = c};
  return edits.put("camera", camera);
}
Edits volume_scene(PutVolume volume, const mat4x3& pose = mat4x3(1)) {
  Edits edits;
  edits.put("fog", std::move(volume)).put("fog/e", showing_volume("fog", pose));
  parallel_camera(edits);
  return edits;
}
/// Means of a plane's channels.
glm::dvec4 mean_of(const Frame& frame, std::size_t plane = 0, u32 channels = 4) {
  glm::dvec4 sum(0);
  const auto values = pixels<float>(frame, plane);
  for (std::size_t i = 0; i < values.size(); ++i) sum[i32(i % channels)] += double(values[i]);
  const std::size_t count = values.size() / channels;
  return sum / double(count);
}
glm::dvec4 mean_beauty(Engine& engine, const Edits& edits, u32 spp, u32 max_depth = 64) {
  RenderJob job = job_of(edits.apply(), {Plane::BEAUTY}, spp);
  job.settings.max_depth = max_depth;
  job.settings.transparent_background = true;
  return mean_of(*render(engine, std::move(job)));
}

}  // namespace

TEST_CASE("volume: a homogeneous box lets exp(-sigma d) of the light pass") {
  const auto engine = make_engine();
  Edits edits = volume_scene({.density = cube_grid(0.25f), .density_scale = 2, .albedo = vec3(0)});
  edits.dome(vec3(1));
  const auto mean = mean_beauty(*engine, edits, 4096);
  CHECK(mean.a == Approx(1 - std::exp(-1.0)).epsilon(0.01));
  CHECK(mean.r == 0);  // what passes is the background, which is transparent
}

TEST_CASE("volume: lengths are the world's, whatever the pose") {
  const auto engine = make_engine();
  // Turned by 45 degrees about y, twice as large: the central rays are 4 sqrt(2) long in it.
  const float s = std::sqrt(0.5f);
  const mat4x3 pose(vec3(2 * s, 0, -2 * s), vec3(0, 20, 0), vec3(2 * s, 0, 2 * s), vec3(0));
  Edits edits = volume_scene({.density = cube_grid(0.2f), .albedo = vec3(0)}, pose);
  double expected = 0;
  for (int i = 0; i < 1000; ++i) {
    const double x = (i + 0.5) / 1000 - 0.5;
    expected += (1 - std::exp(-0.2 * 2 * (2 * std::sqrt(2.0) - std::abs(x)))) / 1000;
  }
  CHECK(mean_beauty(*engine, edits, 4096).a == Approx(expected).epsilon(0.01));
}

TEST_CASE("volume: a white medium vanishes before a uniform sky") {
  const auto engine = make_engine();
  for (const float g : {0.0f, 0.7f}) {
    Edits edits = volume_scene({.density = cube_grid(2), .albedo = vec3(1), .anisotropy = g});
    edits.dome(vec3(1));
    RenderJob job = job_of(edits.apply(), {Plane::BEAUTY}, 1024);
    job.settings.max_depth = 256;
    CHECK(mean_of(*render(*engine, job)).g == Approx(1).epsilon(0.01));
  }
}

TEST_CASE("volume: a glowing box has the radiance of the integral") {
  const auto engine = make_engine();
  const vec3 albedo(0.25f);
  Edits edits = volume_scene({.density = cube_grid(0.5f),
                              .temperature = cube_grid(1),
                              .albedo = albedo,
                              .temperature_scale = 2000,
                              .emission_scale = 0.1f});
  const vec3 black = resident::planckian_color(2000) * float(resident::black_body_luminance(2000));
  const auto mean = mean_beauty(*engine, edits, 4096, 1);
  for (int c = 0; c < 2; ++c)
    CHECK(mean[c] == Approx(double(black[c]) * 0.1 * 0.75 * (1 - std::exp(-1.0))).epsilon(0.015));
}

TEST_CASE("volume: single scattering agrees with quadrature") {
  const auto engine = make_engine();
  // Density rises along the view; the sun shines across it, along -y, from the face at y = 1.
  Light sun;
  sun.unit = LightUnit::kIrradiance;
  sun.sun_angle = 0.01f;
  const mat4x3 down_y(vec3(1, 0, 0), vec3(0, 0, -1), vec3(0, 1, 0), vec3(0));
  const auto grid = box_grid({0.2f, 1.0f}, {1, 1, 2}, scaled({2, 2, 1}, vec3(-1)));
  Edits edits = volume_scene({.density = grid, .albedo = vec3(0.8f), .anisotropy = 0.4f});
  edits.put("sun", PutEntity{.pose = PosePatch{{}, {down_y}}, .light = LightPatch{sun, {}}});
  const auto density = [](double z) { return 0.2 + 0.8 * std::clamp(z + 0.5, 0.0, 1.0); };
  double expected = 0, depth = 0;
  constexpr int kSteps = 2000;
  for (int i = 0; i < kSteps; ++i) {
    const double z = 1 - (i + 0.5) * 2 / kSteps, sigma = density(z);
    depth += sigma * 2 / kSteps;
    double lit = 0;  // over the square that the camera sees
    for (int j = 0; j < 100; ++j) lit += std::exp(-sigma * (1.5 - (j + 0.5) / 100)) / 100;
    expected += std::exp(-depth + sigma / kSteps) * sigma * lit * 2 / kSteps;
  }
  expected *= 0.8 * double(kernels::phase_density(0.4f, 0));
  CHECK(mean_beauty(*engine, edits, 4096, 2).g == Approx(expected).epsilon(0.01));
}

TEST_CASE("volume: shadows on surfaces thin out with the transmittance") {
  const auto engine = make_engine();
  Light sun;
  sun.unit = LightUnit::kIrradiance;
  sun.sun_angle = 0.01f;
  double means[2];
  for (const bool foggy : {false, true}) {
    PutEntity fog = showing_volume("fog");
    fog.visibility = u8(kAllRays & ~kCameraRay);
    Edits edits;
    edits.mesh("quad", quad())
        .object("floor", "quad", scaled(vec3(4), {0, 0, -2}))
        .put("fog", PutVolume{.density = cube_grid(foggy ? 0.5f : 0), .albedo = vec3(0)})
        .put("fog/e", fog)
        .put("sun", PutEntity{.light = LightPatch{sun, {}}});
    parallel_camera(edits);
    means[foggy] = mean_beauty(*engine, edits, 16384, 2).g;
  }
  CHECK(means[1] / means[0] == Approx(std::exp(-1.0)).epsilon(0.01));
}

TEST_CASE("volume: the planes of light sum to beauty; threads change nothing") {
  Edits edits = still_life();
  edits
      .put("fog", PutVolume{.density = std::make_shared<const Grid>(random_grid({19, 16, 9}, 1)),
                            .temperature = cube_grid(1500),
                            .density_scale = 2,
                            .anisotropy = 0.5f})
      .put("fog/e", showing_volume("fog", scaled(vec3(0.1f), {-1, -1, 0})));
  std::vector<Plane> planes{Plane::BEAUTY};
  for (u32 p = u32(Plane::DIRECT_DIFFUSE); p <= u32(Plane::ENVIRONMENT_LIGHT); ++p)
    planes.push_back(Plane(p));
  const auto snapshot = edits.apply();
  const auto frame = render(*make_engine(1), job_of(snapshot, planes, 32));
  const auto beauty = pixels<float>(*frame);
  const auto volume = std::size_t(std::ranges::find(planes, Plane::DIRECT_VOLUME) - planes.begin());
  double direct = 0;
  for (std::size_t i = 0; i < beauty.size() / 4; ++i)
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = 0;
      for (std::size_t p = 1; p < planes.size(); ++p)
        sum += double(pixels<float>(*frame, p)[3 * i + c]);
      REQUIRE(sum == Approx(double(beauty[4 * i + c])).epsilon(1e-4).margin(1e-5));
      direct += double(pixels<float>(*frame, volume)[3 * i + c]);
    }
  CHECK(direct > 0);
  const auto other = make_engine(2);
  (void)render(*other, job_of(Edits().apply(*snapshot), {Plane::BEAUTY}, 1));
  CHECK(same_planes(*frame, *render(*other, job_of(snapshot, planes, 32))));
}

TEST_CASE("volume: a pixel belongs to the volume where half of the light is left") {
  const auto engine = make_engine();
  const std::vector<Plane> planes{Plane::INSTANCE, Plane::DEPTH, Plane::NORMAL,
                                  Plane::OBJECT_COORDINATES};
  struct Row {
    float density;
    u32 label;
    double depth;
  };
  // The box begins at depth 9 and is 2 deep; a floor lies behind it at depth 12.
  for (const Row& row : {Row{0.7f, 5, 9 + std::log(2.0) / 0.7}, Row{0.34f, 6, 12},
                         Row{0.36f, 5, 9 + std::log(2.0) / 0.36}}) {
    PutEntity fog = showing_volume("fog");
    fog.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 5};
    PutEntity floor;
    floor.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 6};
    Edits edits;
    edits.mesh("quad", quad())
        .object("floor", "quad", scaled(vec3(4), {0, 0, -2}))
        .put("floor", floor)
        .put("fog", PutVolume{.density = cube_grid(row.density)})
        .put("fog/e", fog);
    parallel_camera(edits);
    const auto frame = render(*engine, job_of(edits.apply(), planes));
    INFO(row.density);
    CHECK(pixels<u32>(*frame)[5] == row.label);
    CHECK(double(pixels<float>(*frame, 1)[5]) == Approx(row.depth).epsilon(1e-5));
    const vec3 normal(pixels<float>(*frame, 2)[15], 0, pixels<float>(*frame, 2)[17]);
    CHECK(normal.z == (row.label == 5 ? 0.0f : 1.0f));
    if (row.label == 5)
      CHECK(double(pixels<float>(*frame, 3)[17]) == Approx((11 - row.depth) / 2).epsilon(1e-4));
  }
}

TEST_CASE(
    "volume: among overlapping volumes the thickest owns the pixel, where their sum is half") {
  const auto engine = make_engine();
  Edits edits = volume_scene({.density = cube_grid(0.2f)});
  PutEntity other = showing_volume("other");
  other.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 9};
  edits.put("other", PutVolume{.density = cube_grid(0.3f)}).put("other/e", other);
  const auto frame = render(*engine, job_of(edits.apply(), {Plane::INSTANCE, Plane::DEPTH}));
  CHECK(pixels<u32>(*frame)[5] == 9);
  CHECK(double(pixels<float>(*frame, 1)[5]) == Approx(9 + std::log(2.0) / 0.5).epsilon(1e-5));
}
