// .vdb: what OpenVDB wrote is read as the numbers that went in, of every type and compression.
#include <numbers>
#include <set>

#include "tests/unit/catch.h"
#include "tests/unit/vdb_fixture.h"

using namespace heliograph;
using namespace heliograph::test;
using Catch::Matchers::Contains;

namespace {

constexpr double kStep = 0.125;  // halves hold its multiples

/// Every voxel is `scale` times its count.
void check_counts(const Grid& grid, double scale) {
  int wrong = 0;
  each_voxel([&](ivec3 at) { wrong += voxel(grid, at) != float(count_at(at) * scale); });
  CHECK(wrong == 0);
  CHECK(grid.lower == ivec3(-10, -4, 4));
  CHECK(grid.upper == ivec3(8, 11, 19));
}

template <class GridType>
void check_type(double scale) {
  const auto grid = grid_of<GridType>("density", [&](int n) { return n * scale; });
  INFO(grid->type());
  check_counts(*library_item<PutVolume>(loaded_of({grid})).density, scale);
}

}  // namespace

TEST_CASE("vdb: numbers of every type") {
  check_type<vdb::FloatGrid>(kStep);
  check_type<vdb::DoubleGrid>(kStep);
  check_type<vdb::Int32Grid>(3);
  check_type<vdb::Int64Grid>(5);
  for (const bool mask : {false, true}) {
    const vdb::GridBase::Ptr grid =
        mask ? vdb::GridBase::Ptr(grid_of<vdb::MaskGrid>("density", [](int) { return true; }))
             : grid_of<vdb::BoolGrid>("density", [](int n) { return n > 4; });
    const auto density = library_item<PutVolume>(loaded_of({grid})).density;
    int wrong = 0;
    each_voxel([&](ivec3 at) {
      wrong += voxel(*density, at) != float(mask ? count_at(at) != 0 : count_at(at) > 4);
    });
    CHECK(wrong == 0);
  }
}

TEST_CASE("vdb: halves, every compression, files and streams") {
  const auto grid = grid_of<vdb::FloatGrid>("density", [](int n) { return n * kStep; });
  for (const bool half : {false, true})
    for (const bool seekable : {false, true})
      for (const u32 compression : {0u, 1u, 2u, 3u, 4u, 6u}) {
        INFO(half << seekable << compression);
        grid->setSaveFloatAsHalf(half);
        VdbWriter writer;
        writer.seekable = seekable;
        writer.setCompression(compression);
        const auto loaded = writer.bundle({grid}).load();
        INFO(refusal(loaded));
        REQUIRE(loaded);
        check_counts(*library_item<PutVolume>(*loaded).density, kStep);
      }
}

TEST_CASE("vdb: vectors are colours, whatever they hold; other grids are named") {
  const auto check = [](const vdb::GridBase::Ptr& color, double scale) {
    INFO(color->type());
    const auto density = grid_of<vdb::FloatGrid>("density", [](int) { return 1; });
    const auto heat = grid_of<vdb::DoubleGrid>("temperature", [](int n) { return 100 * n; });
    const auto spare = grid_of<vdb::Int32Grid>("flags", [](int n) { return n; });
    const Loaded loaded = loaded_of({spare, color, heat, density});
    const auto& put = library_item<PutVolume>(loaded);
    check_counts(**put.temperature, 100);
    int wrong = 0;
    each_voxel([&](ivec3 at) {
      const auto n = float(count_at(at) * scale);
      wrong += voxel(**put.color, at, 0) != n || voxel(**put.color, at, 1) != n * n ||
               voxel(**put.color, at, 2) != 0;
    });
    CHECK(wrong == 0);
    CHECK(loaded.warnings == std::vector<std::string>{"grid 'flags' is not used"});
  };
  check(grid_of<vdb::Vec3SGrid>(
            "Cd", [](int n) { return vdb::Vec3s(float(n) / 16, float(n * n) / 256, 0); }),
        1.0 / 16);
  check(grid_of<vdb::Vec3DGrid>("color",
                                [](int n) { return vdb::Vec3d(n / 16.0, n * n / 256.0, 0); }),
        1.0 / 16);
  const auto whole =
      grid_of<vdb::Vec3IGrid>("albedo", [](int n) { return vdb::Vec3i(n % 2, 1, 0); });
  const auto density = grid_of<vdb::FloatGrid>("density", [](int) { return 1; });
  const Loaded loaded = loaded_of({density, whole});
  const auto& color = **library_item<PutVolume>(loaded).color;
  CHECK(voxel(color, {1, 1, 7}, 1) == 1);
  CHECK(voxel(color, {1, 1, 7}, 0) == float(count_at({1, 1, 7}) % 2));
}

TEST_CASE("vdb: grids that share a tree are both there") {
  const auto density = grid_of<vdb::FloatGrid>("density", [](int n) { return n * kStep; });
  const auto heat = vdb::FloatGrid::create(density->treePtr());
  heat->setName("temperature");
  heat->setTransform(vdb::math::Transform::createLinearTransform(0.5));
  const Loaded loaded = loaded_of({density, heat});
  const auto& put = library_item<PutVolume>(loaded);
  check_counts(*put.density, kStep);
  check_counts(**put.temperature, kStep);
  CHECK((*put.temperature)->object_from_voxel[1][1] == 0.5f);
}

TEST_CASE("vdb: samples lie where the transform says") {
  const auto grid = grid_of<vdb::FloatGrid>("density", [](int) { return 1; });
  const auto transform = vdb::math::Transform::createLinearTransform(0.25);
  transform->postRotate(0.5, vdb::math::Z_AXIS);
  transform->postTranslate({1, -2, 3});
  transform->preShear(0.5, vdb::math::X_AXIS, vdb::math::Y_AXIS);
  grid->setTransform(transform);
  const auto density = library_item<PutVolume>(loaded_of({grid})).density;
  const vdb::Vec3d expected = transform->indexToWorld(vdb::Vec3d(3, -7, 11));
  const vec3 found = density->object_from_voxel * vec4(3.5f, -6.5f, 11.5f, 1);
  for (int i = 0; i < 3; ++i) CHECK(double(found[i]) == Approx(expected[i]).margin(1e-5));
}

TEST_CASE("vdb: a frustum is resampled to a box") {
  auto grid = vdb::FloatGrid::create();
  grid->setName("density");
  grid->fill(vdb::CoordBBox(vdb::Coord(0), vdb::Coord(19)), 0.5f);
  // Twice as wide at the far end, 4 deep; its area grows from 2*2 to 4*4.
  grid->setTransform(vdb::math::Transform::createFrustumTransform(
      vdb::BBoxd(vdb::Vec3d(0), vdb::Vec3d(20)), 2.0, 4.0, 0.1));
  const auto& world = grid->transform();
  const auto density = library_item<PutVolume>(loaded_of({grid})).density;
  const mat4x3 m = density->object_from_voxel;
  const auto at = [&](const vdb::Vec3d& index) {
    const vdb::Vec3d p = world.indexToWorld(index);
    const vec3 from = vec3(float(p[0]), float(p[1]), float(p[2])) - m[3];
    return voxel(*density, ivec3(glm::floor(from / vec3(m[0][0], m[1][1], m[2][2]))));
  };
  CHECK(m[0][1] == 0);
  for (const double z : {3.0, 10.0, 16.0})
    for (const double x : {3.0, 10.0, 16.0}) CHECK(at({x, 10, z}) == 0.5f);
  CHECK(at({-4, 10, 10}) == 0);
  CHECK(at({10, 24, 3}) == 0);
  double mass = 0;
  for (const float value : density->values.span()) mass += double(value);
  mass *= double(m[0][0] * m[1][1] * m[2][2]);
  double expected = 0;  // by the transform's own volumes
  for (int z = 0; z < 20; ++z)
    expected += 0.5 * 400 * world.voxelSize(vdb::Vec3d(10, 10, z)).product();
  CHECK(mass == Approx(expected).epsilon(0.1));
}

TEST_CASE("vdb: level sets become fog, tiles are filled in") {
  constexpr float kBand = 3;
  auto grid = vdb::FloatGrid::create(kBand);
  grid->setName("ball");
  grid->setGridClass(vdb::GRID_LEVEL_SET);
  const auto distance = [](ivec3 at) { return glm::length(vec3(at)) - 20; };
  for (int x = -30; x <= 30; ++x)
    for (int y = -30; y <= 30; ++y)
      for (int z = -30; z <= 30; ++z) {
        const float d = distance({x, y, z});
        if (d < kBand) grid->tree().setValue({x, y, z}, std::max(d, -kBand));
        if (d <= -kBand) grid->tree().setValueOff({x, y, z}, -kBand);
      }
  grid->pruneGrid();  // the inside becomes tiles
  const Loaded loaded = loaded_of({grid});
  const auto density = library_item<PutVolume>(loaded).density;
  int wrong = 0;
  for (int x = -30; x <= 30; ++x)
    for (int y = -30; y <= 30; ++y)
      for (int z = -30; z <= 30; ++z) {
        const float d = distance({x, y, z});
        wrong += std::abs(voxel(*density, {x, y, z}) - std::clamp(-d / kBand, 0.0f, 1.0f)) > 1e-6f;
      }
  CHECK(wrong == 0);
  CHECK(loaded.warnings ==
        std::vector<std::string>{
            "grid 'ball' is a level set: shown as fog; surface=True makes a mesh of it"});

  auto smoke = vdb::FloatGrid::create();
  smoke->tree().addTile(1, vdb::Coord(8, 0, -8), 2, true);
  smoke->tree().addTile(1, vdb::Coord(16, 0, -8), 2, false);
  const auto tile = library_item<PutVolume>(loaded_of({smoke})).density;
  CHECK(tile->bricks.size() == 1);
  CHECK(tile->bricks[0] == ivec3(1, 0, -1));
  CHECK(std::ranges::all_of(tile->values.span(), [](float v) { return v == 2; }));
}

namespace {

constexpr float kRadius = 20;  // voxels
const vec3 kCentre(3, 1, 2);   // voxels

/// A ball, whose inside becomes tiles.
vdb::FloatGrid::Ptr ball(const std::string& name, const vdb::Mat4d& placed) {
  constexpr float kBand = 3;
  auto grid = vdb::FloatGrid::create(kBand);
  grid->setName(name);
  grid->setGridClass(vdb::GRID_LEVEL_SET);
  grid->setTransform(vdb::math::Transform::createLinearTransform(placed));
  for (int x = -30; x <= 30; ++x)
    for (int y = -30; y <= 30; ++y)
      for (int z = -30; z <= 30; ++z) {
        const float d = glm::length(vec3(x, y, z) - kCentre) - kRadius;
        if (d <= -kBand)
          grid->tree().setValueOff({x, y, z}, -kBand);
        else if (d < kBand)
          grid->tree().setValueOn({x, y, z}, d);
      }
  grid->pruneGrid();
  return grid;
}

/// Above 0 where triangles are seen from outside.
double volume_of(const Loaded& loaded) {
  const PutMesh& mesh = library_item<PutMesh>(loaded);
  double sum = 0;
  for (const uvec3& t : mesh.topology->triangles) {
    const auto& p = mesh.vertices->positions;
    sum += glm::dot(glm::dvec3(p[t.x]), glm::cross(glm::dvec3(p[t.y]), glm::dvec3(p[t.z]))) / 6;
  }
  return sum;
}

}  // namespace

TEST_CASE("vdb: level sets become a mesh") {
  constexpr double kPi = std::numbers::pi, kVoxel = 0.05, kR = kRadius * kVoxel;
  const bool mirrored = GENERATE(false, true);
  vdb::Mat4d placed = vdb::Mat4d::identity();
  placed.preScale(vdb::Vec3d(mirrored ? -kVoxel : kVoxel, kVoxel, kVoxel));
  placed.setTranslation({1, 2, 3});
  const auto loaded = VdbWriter().bundle({ball("ball", placed)}).load({.surface = true});
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  CHECK(volume_of(*loaded) == Approx(4 * kPi / 3 * kR * kR * kR).epsilon(0.005));
  CHECK(area(*loaded) == Approx(4 * kPi * kR * kR).epsilon(0.005));
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  const vec3 centre = vec3(mirrored ? -1 : 1, 1, 1) * kCentre * float(kVoxel) + vec3(1, 2, 3);
  std::set<std::pair<u32, u32>> edges;
  for (const uvec3& t : mesh.topology->triangles)
    for (int i = 0; i < 3; ++i) edges.insert(std::minmax({t[i], t[(i + 1) % 3]}));
  const auto& positions = mesh.vertices->positions;
  const auto& normals = mesh.vertices->normals;
  CHECK(i64(positions.size()) - i64(edges.size()) + i64(mesh.topology->triangles.size()) == 2);
  int wrong = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const vec3 out = positions[i] - centre;
    wrong += std::abs(glm::length(out) - kR) > 0.1 * kVoxel;
    wrong += glm::dot(glm::normalize(out), normals[i]) < 0.999f;
  }
  CHECK(wrong == 0);
}

TEST_CASE("vdb: each level set is a part, and what is none is named") {
  const auto whole = vdb::Mat4d::identity();
  const auto fog = grid_of<vdb::FloatGrid>("density", [](int) { return 1; });
  const auto loaded =
      VdbWriter().bundle({ball("a", whole), fog, ball("b", whole)}).load({.surface = true});
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(library_item<PutMesh>(*loaded).topology->part_names == std::vector<std::string>{"a", "b"});
  CHECK(loaded->warnings == std::vector<std::string>{"no level sets, and left out: 'density'"});

  CHECK_THAT(refusal(VdbWriter().bundle({fog}).load({.surface = true})),
             Contains("surface: no grid is a level set, leave it out; there are: 'density'"));
  auto full = vdb::FloatGrid::create(3);
  full->setName("full");
  full->setGridClass(vdb::GRID_LEVEL_SET);
  full->tree().setValueOn({0, 0, 0}, 1);
  CHECK_THAT(refusal(VdbWriter().bundle({full}).load({.surface = true})),
             Contains("full: has no surface"));
  CHECK_THAT(refusal(TestBundle().add("a.off", "OFF\n0 0 0\n").load({.surface = true})),
             Contains("surface: is of level sets"));
}

TEST_CASE("nvdb: level sets become a mesh") {
  const auto loaded = bundle_of(test_assets() / "volume/torus.nvdb").load({.surface = true});
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const vec3 size = loaded->bounds_max - loaded->bounds_min;
  const double r = std::min({size.x, size.y, size.z}) / 2;
  const double R = std::max({size.x, size.y, size.z}) / 2 - r;
  const double kPi = std::numbers::pi;
  CHECK(volume_of(*loaded) == Approx(2 * kPi * kPi * R * r * r).epsilon(0.02));
  CHECK(area(*loaded) == Approx(4 * kPi * kPi * R * r).epsilon(0.02));
}

TEST_CASE("vdb: what cannot be shown is refused by the grid's name") {
  const auto grid = grid_of<vdb::FloatGrid>("dust", [](int n) { return n * kStep; });
  TestBundle points = VdbWriter().bundle({grid});
  std::string text(reinterpret_cast<const char*>(points.contents[0].data()),
                   points.contents[0].size());
  text.replace(text.find("Tree_float_5_4_3"), 16, "Tree_ptidx_5_4_3");
  CHECK_THAT(refusal(TestBundle().add("a.vdb", text).load()),
             Contains("'dust' (points: turn them into a density"));
  text.replace(text.find("Tree_ptidx_5_4_3"), 16, "Tree_vec2s_5_4_3");
  CHECK_THAT(refusal(TestBundle().add("a.vdb", text).load()), Contains("'dust' (values of type"));

  grid->tree().setValueOn({0, 0, 6}, std::numeric_limits<float>::quiet_NaN());
  CHECK_THAT(refusal(VdbWriter().bundle({grid}).load()),
             Contains("dust: holds a number that is NaN"));
}

TEST_CASE("vdb: sizes are checked before memory is spent") {
  auto grid = vdb::FloatGrid::create();
  grid->setName("bomb");
  grid->tree().addTile(3, vdb::Coord(0), 1, true);  // 4096^3 voxels of a few bytes
  const auto loaded = VdbWriter().bundle({grid}).load();
  REQUIRE_FALSE(loaded);
  CHECK(loaded.error().code == Code::kResourceExhausted);
  CHECK_THAT(refusal(loaded), Contains("bomb: would decode to"));

  const auto small = grid_of<vdb::FloatGrid>("density", [](int) { return 1; });
  const auto limited = VdbWriter().bundle({small}).load({.limits = {.bytes = 10'000}});
  REQUIRE_FALSE(limited);
  CHECK(limited.error().code == Code::kResourceExhausted);
}
