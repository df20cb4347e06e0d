// Boxes about turned points, against the points themselves.
#include "renderer/backend/embree/support.h"

#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using embree::Support;
using resident::Box;

namespace {

Box box_of(std::span<const vec3> points, const mat4x3& map) {
  Box box;
  for (const vec3& p : points) box.extend(map * vec4(p, 1));
  return box;
}
bool contains(const Box& outer, const Box& inner) {
  return glm::all(glm::lessThanEqual(outer.lower, inner.lower)) &&
         glm::all(glm::lessThanEqual(inner.upper, outer.upper));
}
/// How many times larger a box is than one within it, along the axis where it is most.
float looseness(const Box& outer, const Box& inner) {
  const vec3 ratio = (outer.upper - outer.lower) / (inner.upper - inner.lower);
  return std::max({ratio.x, ratio.y, ratio.z});
}

}  // namespace

TEST_CASE("support: boxes hold all points, of any number, size and place") {
  Random random(1);
  for (u32 i = 0; i < 3000; ++i) {
    const vec3 middle = random_vec3(random, i % 3 == 0 ? 1e6f : 1);
    const vec3 size = glm::abs(random_vec3(random, std::pow(10.0f, random.next() * 12 - 6)));
    std::vector<vec3> points(1 + random_below(random, 100));
    for (vec3& p : points) p = middle + random_direction(random) * size;
    const mat4x3 map = random_pose(random, i % 2 == 0 ? 1e4f : 1, i % 5 == 0 ? 1e-4f : 10);
    CHECK(contains(Support(points).under(map), box_of(points, map)));
  }
}

TEST_CASE("support: of a ball they are little larger, wherever it lies, of a cuboid not at all") {
  Random random(2);
  const std::vector<vec3> ball = sphere(64).positions;
  std::vector<vec3> cuboid;
  for (u32 i = 0; i < 8; ++i) cuboid.emplace_back(i & 1 ? 3 : -1, i & 2 ? 2 : 1, i & 4 ? 0 : -1);
  for (u32 i = 0; i < 300; ++i) {
    std::vector<vec3> moved = ball;
    for (vec3& p : moved) p += vec3(7, -3, 5);
    const mat4x3 uneven = random_pose(random, 1, 1);
    CHECK(looseness(Support(cuboid).under(uneven), box_of(cuboid, uneven)) < 1.0001f);
    const mat3 turn = glm::mat3_cast(glm::angleAxis(random.next() * 6, random_direction(random)));
    const mat4x3 turned{turn[0], turn[1], turn[2], vec3(0)};
    CHECK(looseness(Support(moved).under(turned), box_of(moved, turned)) < 1.04f);
  }
}

TEST_CASE("support: many points are as few, by however many threads") {
  Random random(3);
  std::vector<vec3> points(100'000);
  for (vec3& p : points) p = random_direction(random);
  points[77'777] = vec3(4, 5, 6);
  const Box box = Support(points).under(mat4x3(1));
  CHECK(box.upper.x == Approx(4));
  CHECK(box.upper.y == Approx(5));
  CHECK(box.upper.z == Approx(6));
  CHECK(Support().is_empty());
  CHECK(Support(std::span<const vec3>()).is_empty());
}
