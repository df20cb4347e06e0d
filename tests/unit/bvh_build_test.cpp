// The trees themselves: what they hold, that threads do not change them, and that rays find in them
// exactly what they find without.
#include <tbb/global_control.h>

#include <array>
#include <cfloat>

#include "kernels/bvh/bvh_box.h"
#include "kernels/bvh/bvh_tracer.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/bvh/build.h"
#include "tests/unit/bvh_scene.h"
#include "tests/unit/bvh_walker.h"

using namespace heliograph;
using namespace heliograph::test;
using bvh::Box;
using bvh::Tree;
using kernels::Hit;
using kernels::Ray;

namespace {

Tree tree_of(std::span<const Box> boxes, float item_cost = 0.3f) {
  auto tree = bvh::build_tree(boxes, {.item_cost = item_cost}, {});
  REQUIRE(tree);
  return *std::move(tree);
}

void check_sound(std::span<const Box> boxes, float item_cost = 0.3f) {
  test::check_sound(tree_of(boxes, item_cost), boxes);
}

/// All surfaces one by one, in the same arithmetic and with the same choice among equals.
class EverySurface {
 public:
  explicit EverySurface(const BothScenes& scenes) : view_(scenes.view()), bvh_(scenes.bvh_view()) {}

  [[nodiscard]] Hit closest(const Ray& ray, u32 mask) const {
    Hit best{ray.t_max, kNone, kNone, 0, 0};
    for (u32 i = 0; i < view_.instance_count; ++i)
      if (view_.instances[i].visibility & mask) look(i, in_object(i, ray), ray, best);
    return best.instance == kNone ? Hit{INFINITY, kNone, kNone, 0, 0} : best;
  }

 private:
  [[nodiscard]] kernels::ObjectRay in_object(u32 instance, const Ray& ray) const {
    if (view_.instances[instance].segments > 0)
      return kernels::moving_object_ray(view_, instance, ray.time, {ray.origin, ray.direction});
    return kernels::object_ray(bvh_.items[bvh_.item_of_instance[instance]],
                               {ray.origin, ray.direction});
  }
  void keep(const Hit& hit, const Ray& ray, Hit& best) const {
    if (hit.t > best.t || (hit.t == best.t && std::pair(hit.instance, hit.primitive) >=
                                                  std::pair(best.instance, best.primitive)))
      return;
    if ((view_.instances[hit.instance].flags & kernels::kMayBeHole) &&
        !kernels::accepts(view_, ray, hit))
      return;
    best = hit;
  }
  void look(u32 instance, const kernels::ObjectRay& local, const Ray& ray, Hit& best) const {
    const kernels::MeshView& mesh = view_.meshes[view_.instances[instance].mesh];
    if (mesh.shape != kernels::Shape::kTriangles) {
      kernels::ShapeHit hit;
      if (kernels::meet_shape(mesh.shape, {local.origin, local.direction, INFINITY}, hit))
        keep({hit.t, instance, 0, hit.place.x, hit.place.y}, ray, best);
      return;
    }
    const vec3 inverse = kernels::box_ray(local.origin, local.direction).inverse;
    for (u32 t = 0; t < mesh.triangle_count; ++t) {
      const uvec3 c = mesh.triangles[t];
      const kernels::BvhTriangle triangle{kernels::vertex_at(mesh, c.x, ray.time), t,
                                          kernels::vertex_at(mesh, c.y, ray.time), 0,
                                          kernels::vertex_at(mesh, c.z, ray.time), 0};
      kernels::TriangleHit hit;
      if (kernels::meet_triangle(triangle, local.origin, local.direction,
                                 kernels::across(local.direction, inverse), best.t, hit))
        keep({hit.t, instance, t, hit.u, hit.v}, ray, best);
    }
  }

  const kernels::SceneView& view_;
  const kernels::BvhView& bvh_;
};

void check_exact(const std::shared_ptr<const Snapshot>& snapshot, u32 rays, float reach) {
  const BothScenes scenes(snapshot, {0, 1});
  const EverySurface every(scenes);
  const auto bvh = scenes.bvh();
  Random random(9);
  u32 met = 0, differ = 0;
  for (u32 i = 0; i < rays; ++i) {
    Ray ray = random_ray(random, reach);
    if (i % 2) ray.direction = glm::normalize(random_vec3(random, 1) - ray.origin);
    const Hit a = every.closest(ray, kernels::kAllRays);
    const Hit b = bvh.closest(ray, kernels::kAllRays);
    met += a.instance != kNone;
    differ += a.t != b.t || a.instance != b.instance || a.primitive != b.primitive || a.u != b.u ||
              a.v != b.v || (a.instance != kNone) != bvh.occluded(ray, kernels::kAllRays);
  }
  CHECK(met > rays / 100);
  CHECK(differ == 0);
}

}  // namespace

TEST_CASE("bvh build: every item is in its boxes, once") {
  Random random(1);
  for (const u32 count : {1u, 2u, 3u, 4u, 5u, 8u, 9u, 23u, 24u, 25u, 64u, 1000u, 20000u}) {
    INFO(count << " boxes");
    check_sound(random_boxes(random, count, 10, 1));
    check_sound(random_boxes(random, count, 10, 1), 2);
    check_sound(random_boxes(random, count, 1, 100));
  }
  std::vector<Box> boxes = random_boxes(random, 100, 1, 0.1f);
  for (u32 i = 0; i < 100; i += 3) boxes[i] = {};
  check_sound(boxes);
  const Tree none = tree_of({});
  REQUIRE(none.nodes.size() == 1);
  CHECK((none.items.empty() && none.nodes[0].inner == 0));
}

TEST_CASE("bvh build: coincident, flat, huge and tiny boxes") {
  Random random(2);
  check_sound(std::vector<Box>(5000, Box{vec3(1), vec3(2)}));
  check_sound(std::vector<Box>(5000, Box{vec3(3), vec3(3)}));
  std::vector<Box> boxes;
  // Each box half of the one before: splits that put away one box at a time.
  for (int i = 0; i < 120; ++i)
    boxes.push_back({vec3(0), vec3(std::ldexp(1.0f, i % 2 ? 60 - i : -60 + i))});
  for (int i = 0; i < 120; ++i)
    boxes.push_back({vec3(std::ldexp(1.0f, 60 - i)), vec3(std::ldexp(1.0f, 60 - i))});
  check_sound(boxes);
  for (const float size : {1e-38f, 1e-20f, 1e20f, 1e37f})
    check_sound(random_boxes(random, 500, size, size));
  check_sound(random_boxes(random, 500, 1e6f, 1e-3f));
  boxes = random_boxes(random, 500, 1, 1);
  boxes.push_back({vec3(-FLT_MAX), vec3(FLT_MAX)});
  boxes.push_back({vec3(-FLT_MAX), vec3(-FLT_MAX)});
  check_sound(boxes);
  for (Box& box : boxes) box.lower.z = box.upper.z = 7;
  check_sound(boxes);
}

TEST_CASE("bvh build: the same tree for any number of threads") {
  Random random(3);
  const std::vector<Box> boxes = random_boxes(random, 150'000, 10, 0.1f);
  std::vector<Tree> trees;
  for (const std::size_t threads : {1, 2, 8}) {
    const tbb::global_control most(tbb::global_control::max_allowed_parallelism, threads);
    trees.push_back(tree_of(boxes));
  }
  CHECK(same_trees(trees[0], trees[1]));
  CHECK(same_trees(trees[0], trees[2]));
  check_sound(boxes);
}

TEST_CASE("bvh: a mesh that took another shape has the same tree and bounds") {
  Random random(8);
  std::vector<vec3> positions;
  std::vector<uvec3> triangles;
  for (u32 i = 0; i < 300'000; ++i) positions.push_back(random_vec3(random, 10));
  for (u32 i = 0; i < 100'000; ++i) triangles.emplace_back(3 * i, 3 * i + 1, 3 * i + 2);
  positions.emplace_back(1000);  // of no triangle
  MeshTopology topology{.vertex_count = u32(positions.size())};
  topology.triangles = ArrayOf(std::move(triangles));
  VertexKeys keys{.times = {0}, .positions = ArrayOf(std::move(positions)), .normals = {}};
  Mesh mesh{.topology = std::make_shared<const MeshTopology>(std::move(topology)),
            .vertices = std::make_shared<const VertexKeys>(std::move(keys))};
  const bvh::BvhAccelerator accelerator(0);
  const auto made_of = [&](bool reshaped) {
    resident::DerivedCache cache(1ull << 30);
    mesh.reshaped = reshaped;
    auto made = resident::MeshBuilder(accelerator, cache).build(mesh);
    REQUIRE(made);
    CHECK((*made)->is_deformed() == reshaped);
    return *made;
  };
  const auto one = made_of(false), other = made_of(true);
  CHECK(one->rest.upper == other->rest.upper);
  CHECK((other->rest.upper.x > 9.9f && other->rest.upper.x <= 10));
  CHECK(one->accelerator->bounds().lower == other->accelerator->bounds().lower);
  const bvh::BvhTree &a = bvh::tree_of(*one), &b = bvh::tree_of(*other);
  REQUIRE(a.nodes.size() == b.nodes.size());
  CHECK(std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof a.nodes[0]) == 0);
}

TEST_CASE("bvh build: is given up when it is asked to") {
  Random random(4);
  const std::vector<Box> boxes = random_boxes(random, 50'000, 10, 0.1f);
  std::stop_source stop;
  stop.request_stop();
  const auto tree = bvh::build_tree(boxes, {}, {.stop = stop.get_token(), .deadline = {}});
  REQUIRE(!tree);
  CHECK(tree.error().code == Code::kCancelled);
}

TEST_CASE("bvh: finds exactly what a look at every surface finds") {
  Random random(5);
  for (const u32 triangles : {1u, 2u, 3u, 4u, 7u, 24u, 25u, 100u, 400u}) {
    INFO(triangles << " triangles");
    const auto scene = Edits()
                           .mesh("soup", soup(random, triangles, 0.5f, 1.5f))
                           .object("it", "soup", mat4x3(1))
                           .apply();
    check_exact(scene, 2000, 2.5f);
  }
  SECTION("of instances of all kinds") {
    check_exact(random_scene(random, {.count = 4}), 10'000, 6);
  }
  SECTION("of equals, the first") {
    // The same triangles at the same places, by instance and within each.
    Shape shape = soup(random, 20, 1, 1);
    for (u32 i = 0; i < 3; ++i)
      shape.triangles.insert(shape.triangles.end(), shape.triangles.begin(),
                             shape.triangles.begin() + 20);
    Edits edits;
    edits.mesh("soup", shape);
    for (int i = 0; i < 30; ++i) edits.object(fmt::format("it {}", i), "soup", mat4x3(1));
    check_exact(edits.apply(), 5000, 2);
  }
  SECTION("of triangles without an area") {
    Shape shape = soup(random, 50, 1, 1);
    for (u32 i = 0; i < 50; i += 2) shape.triangles[i].z = shape.triangles[i].y;
    for (u32 i = 0; i < 3000; ++i) shape.triangles.push_back({0, 0, 0});
    check_exact(Edits().mesh("m", shape).object("it", "m", mat4x3(1)).apply(), 5000, 2);
  }
  SECTION("of a regular grid whose edges rays pass through") {
    Shape shape;
    for (u32 i = 0; i <= 16; ++i)
      for (u32 j = 0; j <= 16; ++j) shape.positions.push_back({float(i) - 8, float(j) - 8, 0});
    for (u32 i = 0; i < 16; ++i)
      for (u32 j = 0; j < 16; ++j) {
        const u32 a = 17 * i + j;
        shape.triangles.push_back({a, a + 17, a + 1});
        shape.triangles.push_back({a + 1, a + 17, a + 18});
      }
    shape.uvs.resize(shape.positions.size());
    const BothScenes scenes(Edits().mesh("m", shape).object("it", "m", mat4x3(1)).apply(), {});
    u32 missed = 0;
    for (int x = -15; x < 16; ++x)
      for (int y = -15; y < 16; ++y) {
        Ray ray{};
        ray.origin = {0.5f * float(x), 0.5f * float(y), 3};
        ray.direction = {0, 0, -1};
        ray.t_max = 3;  // it ends on the grid
        missed += scenes.bvh().closest(ray, kernels::kAllRays).t != 3;
      }
    CHECK(missed == 0);
  }
}

TEST_CASE("bvh: objects of any size and distance are met") {
  Random random(6);
  for (const float scale : {1e-9f, 1e-6f, 1e6f, 1e7f}) {
    INFO("scale " << scale);
    const auto at = random_vec3(random, 3) * scale;
    const auto scene =
        Edits().mesh("cube", cube()).object("it", "cube", scaled(vec3(scale), at)).apply();
    const BothScenes scenes(scene, {});
    for (u32 i = 0; i < 1000; ++i) {
      Ray ray{};
      ray.direction = random_direction(random);
      ray.origin = at - ray.direction * (2 * scale);
      ray.t_max = INFINITY;
      const Hit hit = scenes.bvh().closest(ray, kernels::kAllRays);
      CHECK((hit.instance == 0 && hit.t > scale && hit.t < 2 * scale));
    }
  }
}

TEST_CASE("bvh: rays that begin beyond reach, or have no numbers, meet nothing") {
  const auto scene = Edits().mesh("cube", cube()).object("it", "cube", mat4x3(1)).apply();
  const BothScenes scenes(scene, {});
  for (const float from : {2 * kernels::kReach, NAN, INFINITY}) {
    Ray ray{};
    ray.origin = {from, 0, 0};
    ray.direction = {-1, 0, 0};
    ray.t_max = INFINITY;
    CHECK(scenes.bvh().closest(ray, kernels::kAllRays).instance == kernels::kNone);
    CHECK(!scenes.bvh().occluded(ray, kernels::kAllRays));
  }
}

TEST_CASE("bvh: a scene without surfaces, or with none that rays meet") {
  Ray ray{};
  ray.direction = {0, 0, 1};
  ray.t_max = INFINITY;
  PutEntity unseen;
  unseen.visibility = 0;
  Edits edits;
  edits.mesh("cube", cube());
  const BothScenes none(edits.apply(), {});
  CHECK(none.bvh().closest(ray, ~0u).instance == kNone);
  CHECK(!none.bvh().occluded(ray, ~0u));
  edits.object("it", "cube", mat4x3(1)).put("it", unseen);
  const BothScenes hidden(edits.apply(), {});
  CHECK(hidden.bvh().closest(ray, ~0u).instance == kNone);
  CHECK(hidden.bvh().closest_in(0, ray).t == 0.5f);  // whatever rays meet it
  CHECK(hidden.bvh().meets(0, ray));
}

TEST_CASE("bvh: a box of what moves holds it at all times") {
  Random random(7);
  const kernels::BvhBox object{vec3(-1, -0.5f, 0), vec3(2, 0.5f, 1)};
  u32 outside = 0;
  float widest = 0;
  for (u32 i = 0; i < 200; ++i) {
    std::array<kernels::MotionKey, 3> keys{};
    for (auto& key : keys) {
      key.translation = random_vec3(random, 3);
      key.rotation = glm::normalize(vec4(random_vec3(random, 1), random.next() * 2 - 1));
      key.xx = 0.5f + random.next();
      key.yy = 0.5f + random.next();
      key.zz = 0.5f + random.next();
      key.xy = key.xz = key.yz = 0.3f * random.next();
    }
    const kernels::BvhBox box = kernels::moving_box(object, keys.data(), 2);
    kernels::BvhBox seen = kernels::no_box();
    for (u32 s = 0; s < 400; ++s) {
      const float u = random.next();
      seen.extend(
          kernels::placed_box(object, kernels::interpolate(keys[s % 2], keys[s % 2 + 1], u)));
    }
    outside += !within({seen.lower, seen.upper}, {box.lower, box.upper});
    widest =
        std::max(widest, glm::length(box.upper - box.lower) / glm::length(seen.upper - seen.lower));
  }
  CHECK(outside == 0);
  CHECK(widest < 1.05f);
}
