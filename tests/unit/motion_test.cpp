#include "renderer/scene/motion.h"

#include <glm/gtc/matrix_transform.hpp>

#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

mat4x3 pose(vec3 translation, float angle, vec3 scale = vec3(1)) {
  const mat4 m = glm::rotate(mat4(1), angle, vec3(0, 0, 1)) * glm::scale(mat4(1), scale);
  return {vec3(m[0]), vec3(m[1]), vec3(m[2]), translation};
}

float difference(const mat4x3& a, const mat4x3& b) {
  float d = 0;
  for (int c = 0; c < 4; ++c) d = std::max(d, glm::length(a[c] - b[c]));
  return d;
}

u32 add(Snapshot& s, const mat4x3& local, u32 parent = ~0u) {
  Entity entity;
  if (parent != ~0u) entity.parent = s.entity_id(parent);
  const u32 index = s.entities.insert(entity);
  s.poses.push_back(local);
  return index;
}

MeshId add_triangle(Snapshot& s, std::vector<Time> times, std::vector<vec3> positions) {
  MeshTopology topology{.vertex_count = 3};
  topology.triangles = ArrayOf<uvec3>(std::vector<uvec3>{{0, 1, 2}});
  Mesh mesh{std::make_shared<MeshTopology>(topology),
            std::make_shared<VertexKeys>(
                VertexKeys{std::move(times), ArrayOf(std::move(positions)), {}})};
  const u32 index = s.meshes.insert({nullptr, std::make_shared<Mesh>(mesh)});
  return MeshId::make(s.meshes.version(index), index);
}

}  // namespace

TEST_CASE("motion: decomposition gives back the matrix, also sheared and mirrored") {
  for (const vec3 scale : {vec3(1), vec3(2, 0.1f, 5), vec3(-1, 1, 1), vec3(1e-3f, 1, 1e3f)}) {
    mat4x3 m = pose({1, 2, 3}, 0.7f, scale);
    m[1] += m[0] * 0.3f;
    const Decomposed d = decompose(m);
    CHECK(difference(compose(d), m) < 2e-4f * glm::length(scale));
    CHECK(glm::length(d.rotation) == Approx(1));
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) CHECK(d.stretch[i][j] == Approx(d.stretch[j][i]).margin(1e-6));
  }
}

TEST_CASE("motion: decomposition of the flat and the nearly flat is a rotation and a stretch") {
  const auto flattened = [](vec3 scale, float shear) {
    mat4x3 m = pose({}, 0.7f, scale);
    m[1] += m[0] * shear;
    return m;
  };
  for (const mat4x3& m :
       {flattened({1, 1, 0}, 0), flattened({0, 1, 1}, 0), flattened({1, 1e-12f, 1}, 0.5f),
        flattened({0, 2, 0}, 0), flattened({0, 0, 0}, 0), flattened({-1, 1e-20f, 3}, 0.1f),
        flattened({1e-20f, 1e-20f, 1e-20f}, 0.3f), flattened({1e15f, 1, 1e-15f}, 0)}) {
    const Decomposed d = decompose(m);
    const float size = glm::length(m[0]) + glm::length(m[1]) + glm::length(m[2]);
    CHECK(difference(compose(d), m) <= 1e-6f * size);
    CHECK(glm::length(d.rotation) == Approx(1));
    CHECK(glm::determinant(glm::mat3_cast(d.rotation)) == Approx(1));
  }
}

TEST_CASE("motion: a mirrored pose moves without collapsing") {
  const mat4x3 a = pose({0, 0, 0}, 0, vec3(-1, 1, 1)), b = pose({0, 0, 0}, 1, vec3(-1, 1, 1));
  for (const float u : {0.1f, 0.5f, 0.9f})
    CHECK(glm::determinant(mat3(interpolate(a, b, u))) == Approx(-1));
}

TEST_CASE("motion: interpolation turns at a constant rate along the shorter arc") {
  const mat4x3 a = pose({0, 0, 0}, 0.2f, vec3(1)), b = pose({4, 0, 0}, 1.4f, vec3(3));
  CHECK(difference(interpolate(a, b, 0.25f), pose({1, 0, 0}, 0.5f, vec3(1.5f))) < 1e-5f);
  CHECK(interpolate(a, b, 0) == a);
  CHECK(interpolate(a, b, 1) == b);
  const mat4x3 c = pose({0, 0, 0}, 3.0f), d = pose({0, 0, 0}, -3.0f);
  CHECK(difference(interpolate(c, d, 0.5f), pose({0, 0, 0}, glm::pi<float>())) < 1e-5f);
}

TEST_CASE("motion: keys are exact at their times and held outside") {
  Snapshot s;
  const u32 i = add(s, mat4x3(1));
  const auto keys = std::make_shared<PoseKeys>(
      PoseKeys{{1, pose({1, 0, 0}, 0)}, {2, pose({3, 0, 0}, 0)}, {4, pose({3, 2, 0}, 0)}});
  s.entities.write(i).keys = keys;
  s.keyed = 1;
  CHECK(local_pose(s, i, 0)[3] == vec3(1, 0, 0));
  CHECK(local_pose(s, i, 1.5)[3] == vec3(2, 0, 0));
  CHECK(local_pose(s, i, 2)[3] == vec3(3, 0, 0));
  CHECK(local_pose(s, i, 3)[3] == vec3(3, 1, 0));
  CHECK(local_pose(s, i, 9)[3] == vec3(3, 2, 0));
}

TEST_CASE("motion: parents compose at each time") {
  Snapshot s;
  const u32 child_first = add(s, pose({1, 0, 0}, 0));
  const u32 parent = add(s, pose({0, 0, 5}, 0.5f));
  s.entities.write(child_first).parent = s.entity_id(parent);
  const u32 grandchild = add(s, pose({0, 2, 0}, 0), child_first);
  const auto all = world_poses(s, 0);
  const mat4x3 expected = multiply(pose({0, 0, 5}, 0.5f), pose({1, 2, 0}, 0));
  CHECK(difference(all[grandchild], expected) < 1e-6f);
  CHECK(all[grandchild] == world_pose(s, grandchild, 0));
}

TEST_CASE("motion: after an advance the old pose is at the old time, and flow is valid") {
  auto old = std::make_shared<Snapshot>();
  const u32 moved = add(*old, pose({0, 0, 0}, 0)), jumped = add(*old, pose({0, 0, 0}, 0));
  Snapshot s = *old;
  s.previous = old;
  s.time = 2;
  s.advances = 1;
  s.poses.write(moved) = pose({4, 0, 0}, 0);
  s.poses.write(jumped) = pose({4, 0, 0}, 0);
  s.entities.write(jumped).teleported = 1;
  const u32 created = add(s, pose({9, 0, 0}, 0));
  CHECK(local_pose(s, moved, 0)[3].x == 0);
  CHECK(local_pose(s, moved, 0.5)[3].x == 1);
  CHECK(local_pose(s, moved, 2)[3].x == 4);
  CHECK(local_pose(s, jumped, 0)[3].x == 4);
  CHECK(local_pose(s, created, 0)[3].x == 9);
  CHECK(flow_valid(s, moved, 2, 0));
  CHECK_FALSE(flow_valid(s, jumped, 2, 0));
  CHECK_FALSE(flow_valid(s, created, 2, 0));
  CHECK(flow_valid(s, created, 2, 4));
  s.entities.write(created).keys =
      std::make_shared<PoseKeys>(PoseKeys{{0, pose({0, 0, 0}, 0)}, {2, pose({1, 0, 0}, 0)}});
  CHECK_FALSE(flow_valid(s, created, 2, 0));
  const u32 child = add(s, mat4x3(1), created);
  CHECK_FALSE(flow_valid(s, child, 2, 0));
}

TEST_CASE("motion: a change of parent keeps the world pose of the old time") {
  auto old = std::make_shared<Snapshot>();
  const u32 hand = add(*old, pose({5, 0, 0}, 0.3f)), thing = add(*old, pose({1, 1, 0}, 0));
  Snapshot s = *old;
  s.previous = old;
  s.time = s.advances = 1;
  s.entities.write(thing).parent = s.entity_id(hand);
  s.poses.write(thing) = pose({0, 0, 1}, 0);
  CHECK(difference(world_pose(s, thing, 0), pose({1, 1, 0}, 0)) < 1e-5f);
  CHECK(difference(world_pose(s, thing, 1), multiply(pose({5, 0, 0}, 0.3f), pose({0, 0, 1}, 0))) <
        1e-6f);
}

TEST_CASE("motion: flow without another end is refused by name") {
  Snapshot s;
  const u32 floor = add(s, mat4x3(1));
  s.entities.write(floor).mesh = add_triangle(s, {0}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  s.entities.write(floor).name = std::make_shared<const std::string>("floor");
  const Status refused = flow_defined(s, 0, 0.1, {});
  REQUIRE_FALSE(refused);
  CHECK(refused.error().code == Code::kFailedPrecondition);
  CHECK(refused.error().message.find("'floor'") != std::string::npos);
  s.entities.write(floor).visible = false;
  CHECK(flow_defined(s, 0, 0.1, {}));
}

TEST_CASE("motion: vertex keys, morph targets and skins move vertices") {
  Snapshot s;
  const u32 i = add(s, pose({7, 0, 0}, 0));
  s.entities.write(i).mesh =
      add_triangle(s, {0, 1}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 2}, {1, 0, 2}, {0, 1, 2}});
  auto world = world_poses(s, 0.25);
  auto vertices = deform(s, i, 0.25, world);
  REQUIRE(vertices);
  CHECK(vertices->positions[1] == vec3(1, 0, 0.5f));

  // One joint that is two metres above the entity lifts its vertices by as much.
  const u32 joint = add(s, pose({7, 0, 2}, 0));
  auto& row = s.meshes.write(s.entities.at(i).mesh.index());
  MeshTopology topology = *row.value->topology;
  topology.joints = ArrayOf<glm::u16vec4>(std::vector<glm::u16vec4>(3, {0, 0, 0, 0}));
  topology.weights = ArrayOf<vec4>(std::vector<vec4>(3, {1, 0, 0, 0}));
  topology.morph_count = 1;
  topology.morph_positions = ArrayOf<vec3>(std::vector<vec3>(3, {1, 0, 0}));
  row.value =
      std::make_shared<Mesh>(Mesh{std::make_shared<MeshTopology>(topology), row.value->vertices});
  s.entities.write(i).skin = std::make_shared<Skin>(Skin{{s.entity_id(joint)}, {mat4x3(1)}});
  s.entities.write(i).morph_weights = std::make_shared<MorphWeights>(MorphWeights{{0, 1}, {0, 1}});
  world = world_poses(s, 0.5);
  vertices = deform(s, i, 0.5, world);
  REQUIRE(vertices);
  CHECK(glm::length(vertices->positions[1] - vec3(1.5f, 0, 3)) < 1e-5f);
}

TEST_CASE("motion: a still mesh is not deformed; one edited since the advance is, in between") {
  auto old = std::make_shared<Snapshot>();
  const u32 i = add(*old, mat4x3(1));
  old->entities.write(i).mesh = add_triangle(*old, {0}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  CHECK_FALSE(deform(*old, i, 0, world_poses(*old, 0)));
  Snapshot s = *old;
  s.previous = old;
  s.time = s.advances = 1;
  auto& row = s.meshes.write(0);
  row.value = std::make_shared<Mesh>(
      Mesh{row.value->topology,
           std::make_shared<VertexKeys>(
               VertexKeys{{0}, ArrayOf(std::vector<vec3>{{0, 0, 4}, {1, 0, 4}, {0, 1, 4}}), {}})});
  CHECK_FALSE(deform(s, i, 1, world_poses(s, 1)));
  const auto between = deform(s, i, 0.25, world_poses(s, 0.25));
  REQUIRE(between);
  CHECK(between->positions[0] == vec3(0, 0, 1));
}

TEST_CASE("motion: morph weights edited since the advance are in between, and normals stay unit") {
  auto old = std::make_shared<Snapshot>();
  const u32 i = add(*old, mat4x3(1));
  old->entities.write(i).mesh = add_triangle(*old, {0}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  auto& row = old->meshes.write(0);
  MeshTopology topology = *row.value->topology;
  topology.morph_count = 1;
  topology.morph_positions = ArrayOf<vec3>(std::vector<vec3>(3, {0, 0, 2}));
  topology.morph_normals = ArrayOf<vec3>(std::vector<vec3>(3, {3, 0, 3}));
  VertexKeys vertices = *row.value->vertices;
  vertices.normals = ArrayOf<vec3>(std::vector<vec3>(3, {0, 0, 1}));
  row.value = std::make_shared<Mesh>(
      Mesh{std::make_shared<MeshTopology>(topology), std::make_shared<VertexKeys>(vertices)});
  Snapshot s = *old;
  s.previous = old;
  s.time = s.advances = 1;
  s.entities.write(i).morph_weights = std::make_shared<MorphWeights>(MorphWeights{{}, {1}});
  const auto between = deform(s, i, 0.5, world_poses(s, 0.5));
  REQUIRE(between);
  CHECK(between->positions[0].z == 1);
  CHECK(glm::length(between->normals[0]) == Approx(1));
  CHECK_FALSE(deform(s, i, 0, world_poses(s, 0)));
}

TEST_CASE("motion: vertices with keys follow them, whatever they were before the advance") {
  auto old = std::make_shared<Snapshot>();
  const u32 i = add(*old, mat4x3(1));
  old->entities.write(i).mesh = add_triangle(*old, {0}, {{9, 9, 9}, {1, 0, 0}, {0, 1, 0}});
  Snapshot s = *old;
  s.previous = old;
  s.time = s.advances = 1;
  auto& row = s.meshes.write(0);
  VertexKeys keys{{0, 1}, ArrayOf(std::vector<vec3>(6, vec3(2))), {}};
  row.value = std::make_shared<Mesh>(Mesh{row.value->topology, std::make_shared<VertexKeys>(keys)});
  CHECK(deform(s, i, 0.5, world_poses(s, 0.5))->positions[0] == vec3(2));
  CHECK(flow_valid(s, i, 1, 0));
  row.value = std::make_shared<Mesh>(
      Mesh{std::make_shared<MeshTopology>(*row.value->topology), row.value->vertices});
  CHECK_FALSE(flow_valid(s, i, 1, 0));
}

TEST_CASE("motion: times that rounding moved still lie within the advance") {
  auto old = std::make_shared<Snapshot>();
  const u32 i = add(*old, mat4x3(1));
  old->entities.write(i).mesh = add_triangle(*old, {0}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  old->time = 0.1;
  Snapshot s = *old;
  s.previous = old;
  s.advances = 1;
  s.time = 0.1 + 0.2;
  CHECK(flow_defined(s, s.time, s.time - 0.2 - 1e-15, {}));
  CHECK_FALSE(flow_defined(s, s.time, s.time + 0.2, {}));
  CHECK_FALSE(flow_defined(s, s.time, s.time - 0.3, {}));
}

TEST_CASE("motion: flow of a skin is invalid when a joint jumped, or when the skin is new") {
  auto old = std::make_shared<Snapshot>();
  const u32 hip = add(*old, pose({}, 0)), knee = add(*old, pose({}, 0), hip);
  const u32 body = add(*old, pose({}, 0));
  old->entities.write(body).mesh = add_triangle(*old, {0}, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  const Skin skin{{old->entity_id(knee)}, {mat4x3(1)}};
  old->entities.write(body).skin = std::make_shared<Skin>(skin);
  Snapshot s = *old;
  s.previous = old;
  s.time = s.advances = 1;
  s.entities.write(body).skin = std::make_shared<Skin>(skin);  // the same again
  CHECK(flow_valid(s, body, 1, 0));
  s.entities.write(hip).teleported = 1;
  CHECK_FALSE(flow_valid(s, body, 1, 0));
  s.entities.write(hip).teleported = 0;
  s.entities.write(body).skin = std::make_shared<Skin>(Skin{{s.entity_id(hip)}, {mat4x3(1)}});
  CHECK_FALSE(flow_valid(s, body, 1, 0));
}
