// Volumes in kernels: grids against their definition, tracking against integrals. Pictures are in
// volume_picture_test.cpp.
#include "kernels/media/volume_march.h"

#include <set>

#include "renderer/derived/black_body.h"
#include "renderer/placement/volume_tree.h"
#include "renderer/placement/volumes.h"
#include "renderer/scene/grid.h"
#include "tests/unit/catch.h"
#include "tests/unit/random_grid.h"

using namespace heliograph;
using namespace heliograph::test;
using kernels::GridView;

namespace {

/// The grid and its table, for kernels.
struct Held {
  Grid grid;
  resident::DerivedCache cache{1 << 30};
  std::shared_ptr<const resident::GridTable> table = resident::grid_table(grid, cache);
  GridView view = resident::grid_view(grid, *table);
};

double voxel_of(const Grid& grid, ivec3 voxel, u32 channel) {
  const ivec3 at = glm::clamp(voxel, grid.lower, grid.upper - 1);
  const auto brick = std::ranges::find(grid.bricks.span(), at >> 3);
  if (brick == grid.bricks.span().end()) return 0;
  const ivec3 in = at & 7;
  const auto i = std::size_t(brick - grid.bricks.span().begin()) * 512 +
                 std::size_t((in.x * 8 + in.y) * 8 + in.z);
  return double(grid.values[i * grid.channels + channel]);
}
/// The definition, with all eight neighbours.
double field_of(const Grid& grid, vec3 p, u32 channel) {
  const glm::dvec3 s = glm::dvec3(p) - 0.5, base = glm::floor(s), w = s - base;
  double sum = 0;
  for (int i = 0; i < 8; ++i) {
    const ivec3 corner(i & 1, (i >> 1) & 1, i >> 2);
    double weight = 1;
    for (int a = 0; a < 3; ++a) weight *= corner[a] ? w[a] : 1 - w[a];
    sum += weight * voxel_of(grid, ivec3(base) + corner, channel);
  }
  return sum;
}

vec3 point_in(const Grid& grid, Random& random) {
  const vec3 u(random.next(), random.next(), random.next());
  return vec3(grid.lower) + u * vec3(grid.upper - grid.lower);
}

kernels::VolumeView volume_of(const Held& held, float density_scale) {
  kernels::VolumeView view{};
  view.instance.world_from_object = view.instance.object_from_world = mat4x3(1);
  view.instance.visibility = kernels::kAllRays;
  view.density = held.view;
  view.density_scale = density_scale;
  view.albedo = vec3(1);
  return view;
}
kernels::BvhBox box_of(const kernels::VolumeView& volume) {
  const kernels::BvhBox box{vec3(volume.density.lower), vec3(volume.density.upper)};
  return kernels::ray_box(volume.instance, nullptr, box);
}

/// Volumes whose voxels are those of their objects, and the tree over them.
struct Cloud {
  std::vector<kernels::VolumeView> volumes;
  std::vector<kernels::VolumeNode> nodes = tree_of(volumes);
  kernels::SceneView scene{};

  explicit Cloud(std::vector<kernels::VolumeView> all) : volumes(std::move(all)) {
    scene.volumes = volumes.data();
    scene.volume_count = u32(volumes.size());
    scene.volume_nodes = nodes.data();
  }
  static std::vector<kernels::VolumeNode> tree_of(std::span<const kernels::VolumeView> volumes) {
    std::vector<kernels::BvhBox> boxes;
    for (const kernels::VolumeView& volume : volumes) boxes.push_back(box_of(volume));
    return resident::make_volume_tree(boxes);
  }
};
double optical_depth(const kernels::VolumeView& volume, const kernels::Ray& ray, float from,
                     float to) {
  constexpr int kSteps = 20000;
  const kernels::GridRay in_grid{ray.origin, ray.direction};
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const float t = from + (to - from) * (float(i) + 0.5f) / kSteps;
    const vec3 p = in_grid.at(t);
    const bool inside = glm::all(glm::greaterThanEqual(p, vec3(volume.density.lower))) &&
                        glm::all(glm::lessThanEqual(p, vec3(volume.density.upper)));
    if (inside) sum += double(kernels::extinction_at(volume, in_grid, t));
  }
  return sum * double(to - from) / kSteps;
}

/// Within so many standard errors: one in 16,000 correct runs would fail.
constexpr double kSigmas = 4;

}  // namespace

TEST_CASE("volume: interpolation is that of the definition") {
  Random random;
  const Held one{random_grid({19, 16, 9}, 1)}, three{random_grid({9, 17, 8}, 3)};
  for (int i = 0; i < 20000; ++i) {
    const vec3 p = point_in(one.grid, random), q = point_in(three.grid, random);
    REQUIRE(double(kernels::interpolate_grid<1>(one.view, p).channel[0]) ==
            Approx(field_of(one.grid, p, 0)).margin(2e-6));
    const auto color = kernels::interpolate_grid<3>(three.view, q);
    for (u32 c = 0; c < 3; ++c)
      REQUIRE(double(color.channel[c]) == Approx(field_of(three.grid, q, c)).margin(2e-6));
  }
}

TEST_CASE("volume: no value exceeds its cell's majorant") {
  Random random(5);
  const Held held{random_grid({33, 20, 26}, 1)};
  for (int i = 0; i < 200000; ++i) {
    const vec3 p = point_in(held.grid, random);
    const auto cell = glm::min(ivec3(glm::floor(p / 8.0f)), held.view.cells - 1);
    const float value = kernels::interpolate_grid<1>(held.view, p).channel[0];
    REQUIRE(value <= held.view.majorants[kernels::cell_row(held.view, cell)]);
  }
  // At the voxels' centres the field takes its largest values.
  for (i32 x = 0; x < 33; ++x)
    for (i32 y = 0; y < 20; ++y) {
      const vec3 p = vec3(x, y, 13) + 0.5f;
      REQUIRE(kernels::interpolate_grid<1>(held.view, p).channel[0] <=
              held.view.majorants[kernels::cell_row(held.view, ivec3(x, y, 13) >> 3)]);
    }
}

TEST_CASE("volume: a walk covers its span, cell by cell") {
  Random random(6);
  const Held held{random_grid({33, 20, 26}, 1)};
  for (int i = 0; i < 2000; ++i) {
    const vec3 from = 3.0f * point_in(held.grid, random) - 20.0f;
    const vec3 to = point_in(held.grid, random);
    kernels::GridRay ray{from, glm::normalize(to - from)};
    if (i % 5 == 0) ray.direction = vec3(0, i % 2 ? 1 : -1, 0);
    const kernels::Span span = kernels::span_in_box(held.view, ray, INFINITY);
    if (!(span.begin < span.end)) continue;
    kernels::CellWalk walk(held.view, ray, span);
    kernels::Span part;
    float at = span.begin;
    for (u64 row; walk.next(part, row);) {
      REQUIRE(part.begin == at);
      at = part.end;
      const vec3 middle = ray.at(0.5f * (part.begin + part.end)) / 8.0f;
      const auto cell = glm::clamp(ivec3(glm::floor(middle)), ivec3(0), held.view.cells - 1);
      if (part.end - part.begin > 1e-3f) REQUIRE(row == kernels::cell_row(held.view, cell));
    }
    REQUIRE(at == span.end);
  }
}

TEST_CASE("volume: free paths and ratio tracking agree with fine marching") {
  const Held held{random_grid({33, 20, 26}, 1)};
  const kernels::VolumeView volume = volume_of(held, 0.2f);
  const Cloud cloud({volume});
  const kernels::SceneView& scene = cloud.scene;
  const vec3 from(-3, 2, 4);
  const kernels::Ray ray{from, glm::normalize(vec3(36, 18, 22) - from), 30, 0, {0, false}};
  const double expected = std::exp(-optical_depth(volume, ray, 0, 30));
  REQUIRE((expected > 0.05 && expected < 0.9));
  constexpr int kRuns = 40000;
  double free = 0, sum = 0, square = 0;
  for (u32 i = 0; i < kRuns; ++i) {
    free += collide(scene, ray, kernels::kCameraRay, 30, 7919 * i).volume == kernels::kNone;
    const double t = double(transmittance(scene, ray, 104729 * i));
    sum += t;
    square += t * t;
  }
  const double mean = sum / kRuns, variance = square / kRuns - mean * mean;
  CHECK(std::abs(mean - expected) < kSigmas * std::sqrt(variance / kRuns));
  const double rate = free / kRuns;
  CHECK(std::abs(rate - expected) < kSigmas * std::sqrt(expected * (1 - expected) / kRuns));
}

TEST_CASE("volume: overlapping volumes add up, and each collides by its share") {
  const Held a{dense_grid(std::vector<float>(512, 1), ivec3(8), 1)},
      b{dense_grid(std::vector<float>(512, 1), ivec3(8), 1)};
  const Cloud cloud({volume_of(a, 0.1f), volume_of(b, 0.3f)});
  const kernels::SceneView& scene = cloud.scene;
  const kernels::Ray ray{{-1, 4, 4}, {1, 0, 0}, INFINITY, 0, {0, false}};
  constexpr int kRuns = 40000;
  double first = 0, second = 0, passed = 0;
  for (u32 i = 0; i < kRuns; ++i) {
    const auto at = collide(scene, ray, kernels::kCameraRay, INFINITY, 7919 * i);
    first += at.volume == 0;
    second += at.volume == 1;
    passed += double(transmittance(scene, ray, 104729 * i));
  }
  const double t = std::exp(-0.4 * 8);
  CHECK(first / kRuns == Approx((1 - t) / 4).margin(kSigmas * 0.0022));
  CHECK(second / kRuns == Approx((1 - t) * 3 / 4).margin(kSigmas * 0.0022));
  CHECK(passed / kRuns == Approx(t).margin(kSigmas * 0.0011));
}

TEST_CASE("volume: through the tree a ray finds what it finds in the list, every volume once") {
  const Held held{dense_grid(std::vector<float>(512, 1), ivec3(8), 1)};
  Random random(7);
  std::vector<kernels::VolumeView> volumes;
  for (u32 i = 0; i < 300; ++i) {
    kernels::VolumeView view = volume_of(held, 0.05f);
    const vec3 place = 100.0f * vec3(random.next(), random.next(), random.next());
    const mat4x3 world(vec3(0.5f, 0, 0), vec3(0, 2, 0), vec3(0, 0, 1), i < 20 ? vec3(50) : place);
    view.instance.world_from_object = world;
    view.instance.object_from_world = inverse(world);
    if (i % 10 == 9) view.instance.visibility = kernels::kShadowRay;
    if (i == 30) view.instance.visibility = 0;
    volumes.push_back(view);
  }
  const Cloud cloud(volumes);
  u32 met = 0, through_tree = 0;
  for (u32 i = 0; i < 2000; ++i) {
    const vec3 from = 120.0f * vec3(random.next(), random.next(), random.next()) - 10.0f;
    const vec3 to = 100.0f * vec3(random.next(), random.next(), random.next());
    const vec3 along = i % 5 == 0 ? vec3(i % 2, 1 - i % 2, 0) : glm::normalize(to - from);
    const kernels::Ray ray{from, along, i % 3 == 0 ? 40.0f : INFINITY, 0, {0, false}};
    std::set<u32> visited;
    visit_volumes(cloud.scene, ray, kernels::kCameraRay, ray.t_max, [&](u32 volume, float&) {
      CHECK(visited.insert(volume).second);
      return true;
    });
    through_tree += u32(visited.size());
    float passes = 1, nearest = ray.t_max;
    for (u32 k = 0; k < volumes.size(); ++k) {
      const kernels::VolumeView& view = volumes[k];
      const kernels::HashSequence sequence(i + k);
      const auto local = kernels::to_volume(cloud.scene, view, ray);
      const auto span = kernels::span_in_box(view.density, local, ray.t_max);
      const bool camera = view.instance.visibility & kernels::kCameraRay;
      if (span.begin < span.end && camera) {
        CHECK(visited.contains(k));
        ++met;
      }
      if (camera) nearest = std::min(nearest, collide(cloud.scene, view, ray, ray.t_max, sequence));
      if (view.instance.visibility & kernels::kShadowRay)
        passes *= transmittance(cloud.scene, view, ray, sequence);
    }
    const auto at = collide(cloud.scene, ray, kernels::kCameraRay, ray.t_max, i);
    CHECK(at.t == Approx(nearest));
    CHECK((at.volume == kernels::kNone) == (nearest == ray.t_max));
    CHECK(transmittance(cloud.scene, ray, i) == Approx(passes));
  }
  CHECK(met > 1000);
  CHECK(through_tree < 2 * met);
}

TEST_CASE("volume: a majorant without bound ends in time") {
  std::vector<float> values(512, 0);
  values[0] = 1e9f;
  const Held held{dense_grid(values, ivec3(8), 1)};
  const kernels::VolumeView volume = volume_of(held, 1e9f);
  const Cloud cloud({volume});
  const kernels::SceneView& scene = cloud.scene;
  const kernels::Ray ray{{-1, 7.5f, 7.5f}, {1, 0, 0}, INFINITY, 0, {0, false}};
  CHECK(collide(scene, ray, kernels::kCameraRay, INFINITY, 1).volume == kernels::kNone);
  CHECK(transmittance(scene, ray, 1) == 1);
}

TEST_CASE("volume: black bodies have Planck's luminance and the locus' colour") {
  // Freezing platinum, 2041.4 K: 60 cd / cm^2, the former definition of the candela.
  CHECK(683 * resident::black_body_luminance(2041.4) == Approx(6e5).epsilon(0.02));
  kernels::SceneView scene{};
  scene.black_body = resident::black_body_table().data();
  for (const double kelvin : {450.0, 900.0, 1500.0, 2700.0, 6500.0, 20000.0}) {
    const vec3 expected =
        resident::planckian_color(kelvin) * float(resident::black_body_luminance(kelvin));
    const vec3 found = kernels::black_body(scene, float(kelvin));
    const float scale = std::max({expected.x, expected.y, expected.z});
    INFO(kelvin);
    for (int c = 0; c < 3; ++c) CHECK(found[c] / scale == Approx(expected[c] / scale).margin(0.01));
  }
  CHECK(kernels::black_body(scene, 300) == vec3(0));
}
