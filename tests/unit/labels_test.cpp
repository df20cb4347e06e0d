#include "renderer/scene/labels.h"

#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

struct Builder {
  Snapshot s;
  MeshId mesh(u32 parts) {
    MeshTopology topology{.vertex_count = 3, .part_count = parts};
    const Mesh mesh{std::make_shared<MeshTopology>(topology), std::make_shared<VertexKeys>()};
    const u32 index = s.meshes.insert({nullptr, std::make_shared<Mesh>(mesh)});
    return MeshId::make(s.meshes.version(index), index);
  }
  u32 add(Label label, MeshId mesh = {}, i32 parent = -1) {
    Entity entity{.mesh = mesh, .label = label};
    if (parent >= 0) entity.parent = s.entity_id(u32(parent));
    const u32 index = s.entities.insert(entity);
    s.poses.push_back(mat4x3(1));
    return index;
  }
};

Label value(u32 v, u32 category = 0, u32 part = 0) {
  return {.value = v, .set = true, .part = part, .category = category};
}

}  // namespace

TEST_CASE("labels: a label belongs to a subtree, rows are ordered by label") {
  Builder b;
  const MeshId mesh = b.mesh(1);
  const u32 arm = b.add(value(9, 2));
  const u32 link = b.add({}, mesh, i32(arm));
  const u32 gripped = b.add(value(4), mesh, i32(link));
  const u32 loose = b.add({}, mesh);
  const u32 opted_out = b.add(value(0), mesh, i32(arm));
  const Labelling l = label_entities(b.s);
  REQUIRE(l.instances.size() == 2);
  CHECK(l.instances[0].label == 4);
  CHECK(l.instances[1].label == 9);
  CHECK(l.instances[1].root == arm);
  CHECK(l.instances[1].entities == std::vector<u32>{link});
  CHECK(l.entities[link].instance == 9);
  CHECK(l.entities[link].category == 2);
  CHECK(l.entities[link].root == arm);
  CHECK(l.entities[gripped].instance == 4);
  CHECK(l.entities[loose].instance == 0);
  CHECK(l.entities[opted_out].instance == 0);
}

TEST_CASE("labels: parts count from 1, several mesh parts take several, a given number is one") {
  Builder b;
  const u32 root = b.add(value(1));
  const u32 two = b.add({}, b.mesh(2), i32(root));
  const u32 fixed = b.add({.part = 3}, b.mesh(2), i32(root));
  const u32 next = b.add({}, b.mesh(2), i32(root));
  const Labelling l = label_entities(b.s);
  CHECK(l.entities[two].part == 1);
  CHECK(l.entities[fixed].part == 3);
  CHECK(l.entities[next].part == 4);
  CHECK(l.entities[root].part == 0);
}

TEST_CASE("labels: what is invisible keeps its row and shows no entity") {
  Builder b;
  const u32 root = b.add(value(1));
  const u32 child = b.add({}, b.mesh(1), i32(root));
  b.s.entities.write(root).visible = false;
  const Labelling l = label_entities(b.s);
  REQUIRE(l.instances.size() == 1);
  CHECK(l.instances[0].entities.empty());
  CHECK(l.entities[child].instance == 1);
}

TEST_CASE("labels: a group joins unrelated entities in one row") {
  Builder b;
  const MeshId mesh = b.mesh(1);
  Label group = value(6);
  group.group = true;
  const u32 first = b.add(group, mesh), second = b.add(group, mesh);
  const Labelling l = label_entities(b.s);
  REQUIRE(l.instances.size() == 1);
  CHECK(l.instances[0].root == first);
  CHECK(l.instances[0].entities == std::vector<u32>{first, second});
  CHECK(l.entities[second].part == 2);
}

TEST_CASE("labels: the topmost entity is the root, whatever the order of indices") {
  Builder b;
  const MeshId mesh = b.mesh(1);
  const u32 leaf = b.add(value(5), mesh);
  const u32 middle = b.add(value(7));
  const u32 top = b.add(value(5, 3));
  b.s.entities.write(leaf).parent = b.s.entity_id(middle);
  b.s.entities.write(middle).parent = b.s.entity_id(top);
  const Labelling l = label_entities(b.s);
  CHECK(l.entities[leaf].instance == 5);
  CHECK(l.entities[leaf].root == top);
  CHECK(l.instances[0].root == top);
  CHECK(l.instances[0].category == 3);
}

TEST_CASE("labels: classes are inherited, and end where something opts out") {
  Builder b;
  const u32 top = b.add(value(1, 2));
  const u32 inner = b.add(value(3), b.mesh(1), i32(top));
  const u32 out = b.add(value(0), b.mesh(1), i32(top));
  const u32 stuff = b.add(value(0, 4), b.mesh(1), i32(top));
  const Labelling l = label_entities(b.s);
  CHECK(l.entities[inner].category == 2);
  CHECK(l.entities[out].category == 0);
  CHECK(l.entities[stuff].category == 4);
  CHECK(l.entities[stuff].instance == 0);
}

TEST_CASE("labels: hiding an entity renumbers no other") {
  Builder b;
  const u32 root = b.add(value(1));
  const u32 first = b.add({}, b.mesh(2), i32(root)), second = b.add({}, b.mesh(1), i32(root));
  CHECK(label_entities(b.s).entities[second].part == 3);
  b.s.entities.write(first).visible = false;
  CHECK(label_entities(b.s).entities[second].part == 3);
  CHECK(label_entities(b.s).instances[0].entities == std::vector<u32>{second});
}

TEST_CASE("labels: automatic parts go around explicit ones, in index order") {
  Builder b;
  const u32 root = b.add(value(1));
  const auto add = [&](u32 parts, u32 part) {
    return b.add({.part = part}, b.mesh(parts), i32(root));
  };
  const std::vector<u32> entities{add(1, 0), add(2, 2), add(2, 0), add(1, 7),
                                  add(3, 6), add(2, 0), add(1, 0)};
  const Labelling l = label_entities(b.s);
  std::vector<u32> parts;
  for (const u32 i : entities) parts.push_back(l.entities[i].part);
  CHECK(parts == std::vector<u32>{1, 2, 3, 7, 6, 8, 10});
}
