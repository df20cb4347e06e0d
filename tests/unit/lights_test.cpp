// Lights of a scene through the engine: strengths of shapes, static emitters, emission maps.
#include "renderer/lights/lights.h"

#include "tests/unit/catch.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using resident::cone_of;
using resident::LightExtent;
using resident::shape_extent;

namespace {

constexpr double kPi = M_PI;

Light shape(LightShape kind, LightUnit unit, float strength) {
  return {.intensity = strength, .unit = unit, .shape = kind};
}
mat4x3 rescale_uniform(vec3 s) { return scaled(s, vec3(0)); }

/// W that a light of radiance 1 and half angle `outer` sends, by quadrature over directions.
double quadrature(const Light& light, bool flat) {
  const resident::LightCone cone = cone_of(light);
  double sum = 0;
  const int n = 200000;
  for (int i = 0; i < n; ++i) {
    const double c = (i + 0.5) / n;
    const double share = std::clamp((c - double(cone.cosine)) * double(cone.scale), 0.0, 1.0);
    sum += share * share * (flat ? c : 1) * 2 * kPi / n;
  }
  return sum;
}

double mean_of(const Frame& frame, std::size_t plane, u32 channel) {
  const auto values = pixels<float>(frame, plane);
  double sum = 0;
  for (std::size_t i = channel; i < values.size(); i += 4) sum += double(values[i]);
  return sum / (double(values.size()) / 4);
}

/// A matt floor of 10 m and albedo 0.5.
void add_floor(Edits& edits) {
  PutMaterial matt;
  matt.parameters[std::size_t(MaterialParameter::specular)].value = vec3(0);
  edits.mesh("quad", quad()).material("grey", vec3(0.5f)).put("grey", matt);
  edits.object("floor", "quad", scaled(vec3(10), vec3(0)), "grey");
}

/// A floor under 63 small boxes and a lamp, all of them static or none.
Edits shelf(bool is_static) {
  Edits edits = still_life();
  for (int i = 0; i < 63; ++i) {
    const std::string name = "box" + std::to_string(i);
    const int row = i / 9;
    edits.object(name, "cube", scaled(vec3(0.1f), {0.4f * float(i % 9) - 2, 0.4f * float(row), 0}));
    PutEntity flag;
    flag.is_static = is_static;
    edits.put(name, flag);
  }
  PutEntity flag;
  flag.is_static = is_static;
  for (const char* name : {"floor", "box", "ball", "lamp"}) edits.put(name, flag);
  return edits;
}

}  // namespace

TEST_CASE("lights: what shapes make of their strengths") {
  using enum LightShape;
  using enum LightUnit;
  const auto radiance = [](const Light& light, vec3 size) {
    return double(resident::light_radiance(light, shape_extent(light, rescale_uniform(size))).y);
  };
  CHECK(radiance(shape(kSphere, kIntensity, 3), vec3(0.5f)) == Approx(3 / (kPi * 0.25)));
  CHECK(radiance(shape(kSphere, kCandela, 683), vec3(0.5f)) == Approx(1 / (kPi * 0.25)));
  CHECK(radiance(shape(kSphere, kPower, 3), vec3(0.5f)) == Approx(3 / (kPi * 4 * kPi * 0.25)));
  CHECK(radiance(shape(kDisc, kIntensity, 3), vec3(2)) == Approx(3 / (kPi * 4)));
  CHECK(radiance(shape(kDisc, kPower, 3), vec3(2)) == Approx(3 / (kPi * kPi * 4)));
  CHECK(radiance(shape(kRectangle, kIntensity, 3), vec3(2, 3, 1)) == Approx(3.0 / 6));
  Light both = shape(kRectangle, kLumen, 683);
  both.two_sided = true;
  CHECK(radiance(both, vec3(2, 3, 1)) == Approx(1 / (kPi * 12)));
  // A spheroid of semi-axes 1, 1, 2: 2 pi (1 + 2 asin(e) / e), e^2 = 3 / 4.
  const double e = std::sqrt(0.75);
  const double area = 2 * kPi * (1 + 2 / e * std::asin(e));
  CHECK(shape_extent(shape(kSphere, kPower, 1), rescale_uniform({1, 1, 2})).flux ==
        Approx(kPi * area).epsilon(1e-4));
}

TEST_CASE("lights: the power of cones is the integral of their profile") {
  for (const auto& [inner, outer] :
       {std::pair{0.0f, 0.5f}, {0.3f, 0.6f}, {0.5999f, 0.6f}, {0.0f, 1.5707f}, {0.0f, 0.02f}}) {
    for (const LightShape kind : {LightShape::kSphere, LightShape::kDisc}) {
      Light light = shape(kind, LightUnit::kPower, 1);
      light.inner_cone_angle = inner;
      light.outer_cone_angle = outer;
      const LightExtent extent = shape_extent(light, mat4x3(1));
      const bool flat = kind == LightShape::kDisc;
      INFO("inner " << inner << " outer " << outer << " flat " << flat);
      CHECK(extent.flux == Approx(kPi * quadrature(light, flat)).epsilon(0.01));
      CHECK(extent.intensity == Approx(kPi));
    }
  }
}

TEST_CASE("lights: emitters in the static group light as they do outside") {
  const auto engine = make_engine();
  std::shared_ptr<const Frame> frames[2];
  for (const bool is_static : {false, true})
    frames[is_static] =
        render(*engine, job_of(shelf(is_static).apply(), {Plane::BEAUTY, Plane::EMISSION}, 64));
  CHECK(mean_of(*frames[1], 0, 1) == Approx(mean_of(*frames[0], 0, 1)).epsilon(1e-3));
  CHECK(frames[1]->planes[1].pixels == frames[0]->planes[1].pixels);
}

TEST_CASE("lights: irradiance below each shape has its closed form, through Embree (0.5 %)") {
  // Disc: r^2 / (r^2 + d^2); sphere: (r / d)^2; rectangle: four times Howell's C-11. All for d = 1.
  const auto corner = [](double a, double b) {
    const double x = std::sqrt(1 + a * a), y = std::sqrt(1 + b * b);
    return (a / x * std::atan(b / x) + b / y * std::atan(a / y)) / (2 * kPi);
  };
  const std::pair<LightShape, double> cases[] = {{LightShape::kSphere, 0.16},
                                                 {LightShape::kDisc, 0.16 / 1.16},
                                                 {LightShape::kRectangle, 4 * corner(0.4, 0.3)}};
  const auto engine = make_engine();
  for (const auto& [kind, form] : cases) {
    Light light = shape(kind, LightUnit::kRadiance, 2);
    light.radius = 0.4f;
    light.width = 0.8f;
    light.height = 0.6f;
    Edits edits;
    add_floor(edits);
    edits.light("lamp", light).pose("lamp", translation({0, 0, 1}));
    edits.camera("camera", look_at({0.1f, 0, 0.3f}, {0, 0, 0}), 16, 16, 4000);
    const auto frame = render(*engine, job_of(edits.apply(), {Plane::BEAUTY}, 256));
    INFO("shape " << int(kind));
    CHECK(mean_of(*frame, 0, 1) == Approx(0.5 * 2 * form).epsilon(0.005));
  }
}

TEST_CASE("lights: a shape shows its radiance, its outline and its label; it absorbs the rest") {
  const auto engine = make_engine();
  for (const LightShape kind : {LightShape::kSphere, LightShape::kDisc, LightShape::kRectangle}) {
    Light light = shape(kind, LightUnit::kRadiance, 5);
    light.radius = light.width = light.height = 0.75f;
    Edits edits = Edits().dome(vec3(1)).light("lamp", light);
    PutEntity labelled;
    labelled.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 9, .category = {}};
    edits.put("lamp", labelled);
    for (const float side : {-1.0f, 1.0f}) {
      edits.camera("camera", look_at({0, 0, 3 * side}, {0, 0, 0}), 32, 32, 32);
      RenderJob job = job_of(edits.apply(), {Plane::BEAUTY, Plane::DEPTH, Plane::INSTANCE}, 4);
      job.labels.boxes = true;
      const auto frame = render(*engine, std::move(job));
      const auto beauty = pixels<float>(*frame, 0), depth = pixels<float>(*frame, 1);
      const auto label = pixels<u32>(*frame, 2);
      const std::size_t middle = 16 * 32 + 16;
      const bool front = side < 0 || kind == LightShape::kSphere;
      CHECK(beauty[middle * 4] == (front ? 5 : 0));
      CHECK(beauty[0] == 1);
      CHECK(depth[middle] == Approx(kind == LightShape::kSphere ? 2.25f : 3).epsilon(1e-3));
      CHECK(label[middle] == 9);
      // Pixels it covers: a disc of radius 0.75, or a square of 0.75, at f = 32 and 3 m.
      const double far2 = kind == LightShape::kSphere ? 9 - 0.5625 : 9;
      const double r2 = 0.5625 / far2 * 1024;
      const double want = kind == LightShape::kRectangle ? r2 : kPi * r2;
      CHECK(double(std::ranges::count(label, 9u)) == Approx(want).epsilon(0.06));
    }
  }
}

TEST_CASE("lights: a shape that moves, grows or turns dark is seen so at once") {
  const auto engine = make_engine();
  Light light = shape(LightShape::kSphere, LightUnit::kRadiance, 5);
  light.radius = 0.5f;
  const auto count = [&](const std::shared_ptr<const Snapshot>& scene) {
    const auto frame = render(*engine, job_of(scene, {Plane::BEAUTY}, 1));
    const auto beauty = pixels<float>(*frame, 0);
    return std::ranges::count(beauty, 5.0f) / 3;
  };
  const auto first = Edits()
                         .light("lamp", light)
                         .camera("camera", look_at({0, 0, -3}, {0, 0, 0}), 32, 32, 32)
                         .apply();
  const auto small = count(first);
  light.radius = 1;
  CHECK(count(Edits().light("lamp", light).apply(*first)) > 3 * small);
  CHECK(count(Edits().pose("lamp", translation({9, 0, 0})).apply(*first)) == 0);
  light.intensity = 0;
  CHECK(count(Edits().light("lamp", light).apply(*first)) == 0);
}

TEST_CASE("lights: an emission map weighs the triangles of its mesh") {
  auto texture = std::make_shared<Texture>();
  auto image = std::make_shared<ImageData>();
  image->texels = ArrayOf(std::vector<float>{4, 1, 0, 2}).buffer();  // top row, bottom row
  image->width = image->height = 2;
  image->channels = 1;
  image->type = TexelType::kF32;
  texture->image = image;
  texture->nearest = true;
  // Four unit squares, one for each texel.
  Shape grid;
  for (const vec2 at : {vec2(0, 0), vec2(1, 0), vec2(0, 1), vec2(1, 1)}) {
    const u32 first = u32(grid.positions.size());
    for (const vec2 c : quad().uvs) {
      grid.positions.emplace_back(at + c, 0);
      grid.uvs.push_back(0.5f * (at + c));
    }
    grid.triangles.push_back({first, first + 1, first + 2});
    grid.triangles.push_back({first, first + 2, first + 3});
  }
  const auto scene = Edits().mesh("grid", grid).object("sheet", "grid", mat4x3(1)).apply();
  resident::DeviceMesh mesh;
  const Shared<Mesh>& row = *scene->find(scene->find(entity(*scene, "sheet"))->mesh);
  mesh.topology = row.value->topology;
  mesh.vertices = row.value->vertices;
  mesh.positions = mesh.vertices->positions;
  resident::DerivedCache cache(1 << 20);
  const auto trees = resident::part_trees(mesh, {texture.get(), {}}, cache);
  const float want[] = {0.035f, 2, 4, 1};  // v = 0 is the bottom row; black keeps a little
  for (u32 i = 0; i < 8; ++i) {
    const auto& e = trees->entries[trees->entry_of_triangle[i]];
    CHECK(e.radiosity == Approx(want[i / 2]).epsilon(0.03));
    CHECK(e.power == Approx(0.5f * e.radiosity));
  }
  CHECK(resident::part_trees(mesh, {texture.get(), {}}, cache) == trees);
  CHECK(resident::part_trees(mesh, {}, cache)->entries[0].radiosity == 1);
}

TEST_CASE("lights: a dome is sampled where it exceeds its mean, and lights all the same (0.5 %)") {
  // Above the horizon 8 in a quarter of the azimuths and 1 elsewhere, below it 1.
  PutTexture sky{.nearest = true};
  auto image = std::make_shared<ImageData>();
  image->texels = ArrayOf(std::vector<float>{8, 1, 1, 1, 1, 1, 1, 1}).buffer();
  image->width = 4;
  image->height = 2;
  image->channels = 1;
  image->type = TexelType::kF32;
  sky.image = image;
  Edits edits;
  edits.put("sky", sky);
  add_floor(edits);
  edits.camera("camera", look_at({0, 0, 3}, {0, 0, 0}), 16, 16, 32);
  PutSettings settings;
  settings.dome = PutDome{.texture = Ref("sky")};
  edits.put(settings);
  const auto scene = edits.apply();
  resident::DerivedCache cache(1 << 20);
  const auto tables = resident::dome_tables(*scene->find(scene->dome->texture)->value, cache);
  CHECK(tables->row_cdf == std::vector<float>{1, 1});
  CHECK(tables->column_cdf[0] == 1);
  CHECK(tables->integral.y == Approx(2 * kPi * 3.75));
  const auto engine = make_engine();
  const auto frame = render(*engine, job_of(scene, {Plane::BEAUTY}, 256));
  CHECK(mean_of(*frame, 0, 1) == Approx(0.5 * 2.75).epsilon(0.005));
}
