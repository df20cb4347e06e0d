// describe(): a scene, described and built again, is the same scene.
#include "renderer/scene/labels.h"
#include "renderer/scene/motion.h"
#include "renderer/scene/scene.h"
#include "tests/unit/dump.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

std::shared_ptr<const Snapshot> rebuilt(const Snapshot& snapshot) {
  auto made = rebuild(describe(snapshot), {});
  INFO((made ? "" : made.error().where + ": " + made.error().message));
  REQUIRE(made);
  return *made;
}

/// Describes, builds again, and compares what was described and what is shown.
void check_round_trip(const Snapshot& snapshot) {
  const auto copy = rebuilt(snapshot);
  CHECK(dump::text(*copy) == dump::text(snapshot));
  const Labelling before = label_entities(snapshot), after = label_entities(*copy);
  std::vector<std::tuple<u32, u32, u32>> a, b;
  snapshot.entities.for_each([&](u32 i, const Entity&) {
    const EntityLabel& l = before.entities[i];
    a.emplace_back(l.instance, l.category, l.part);
  });
  copy->entities.for_each([&](u32 i, const Entity&) {
    const EntityLabel& l = after.entities[i];
    b.emplace_back(l.instance, l.category, l.part);
  });
  CHECK(a == b);
}

}  // namespace

TEST_CASE("describe: everything a scene can hold") {
  Stage scene;
  MeshTopology skinned = *triangle().topology;
  skinned.joints = ArrayOf<glm::u16vec4>(std::vector<glm::u16vec4>(3, {0, 1, 0, 0}));
  skinned.weights = ArrayOf<vec4>(std::vector<vec4>(3, {0.5f, 0.5f, 0, 0}));
  skinned.morph_count = 1;
  PutMaterial glass = textured("image");
  glass.normal_map = TextureUsePatch{.texture = "image", .use = {.uv_set = 1, .scale = 2}};
  glass.alpha_mode = AlphaMode::kMask;
  glass.alpha_cutoff = 0.25f;
  glass.unlit = true;
  PutEntity body{.pose = PosePatch{.times = {0, 2}, .matrices = {at(0), at(4)}},
                 .mesh = "body",
                 .materials = {{"glass", Id{}}},
                 .visible = false,
                 .visibility = u8(kCameraRay),
                 .is_static = true,
                 .shadow_catcher = true,
                 .attributes = Attributes{{"k", "v"}},
                 .light_group = "key"};
  body.light = LightPatch{.light = {.intensity = 3, .unit = LightUnit::kLumen},
                          .texture = {.texture = "image", .use = {.offset = 1}},
                          .profile = "image"};
  body.portal = Portal{.width = 2, .height = 3};
  body.skin = SkinPatch{.joints = {"hip", "knee"}, .inverse_binds = {at(1), at(2)}};
  body.morph_weights = MorphWeights{{0, 1}, {0.25f, 0.5f}};
  body.label = LabelPatch{.kind = LabelPatch::Kind::kAuto, .category = "person", .part = 4};
  scene({anonymous(PutSettings{.time = 1, .categories = {"unused", "thing"}}),
         named("image", texture()), named("glass", glass), anonymous(PutMaterial{}),
         named("body", PutMesh{.topology = std::make_shared<const MeshTopology>(skinned),
                               .vertices = triangle().vertices}),
         named("smoke", volume()), named("hip", PutEntity{}), named("knee", beneath("hip")),
         named("man", body), anonymous(PutEntity{.parent = "man", .volume = "smoke"}),
         named("eye", PutEntity{.camera = Camera{.width = 8, .height = 4, .fx = 7}}),
         named("g1", labelled(70, true)), named("g2", labelled(70, true)),
         named("t", classed("thing")),
         anonymous(PutSettings{.dome = PutDome{.texture = "image",
                                               .color = std::optional(vec3(1, 2, 3)),
                                               .intensity = 2,
                                               .camera_visible = false,
                                               .light_group = "sky"}})});
  check_round_trip(*scene.now);
  const auto copy = rebuilt(*scene.now);
  CHECK(copy->poses[copy->find("man").value().index()] == at(2));
  CHECK(copy->categories->at(2) == "person");
  CHECK(copy->find(EntityId(copy->find("hip").value()))->skins == 1);
}

TEST_CASE("describe: children before their parents, and labels that lost their ancestor") {
  Stage scene;
  scene({named("tri", triangle()), named("child", PutEntity{}), named("middle", PutEntity{}),
         named("root", labelled(8))});
  scene({named("middle", beneath("root")), named("child", beneath("middle")),
         named("child", showing("tri")), named("gap", PutEntity{}), named("late", PutEntity{})});
  CHECK_FALSE(scene.entity("child").label.set);
  check_round_trip(*scene.now);
  CHECK_FALSE(rebuilt(*scene.now)->find(EntityId(scene.id("child")))->label.set);
  scene({named("child", beneath(Id{})), named("gap", Remove{})});
  CHECK_FALSE(scene.entity("child").label.set);
  check_round_trip(*scene.now);
}

TEST_CASE("describe: what happened since the last advance, for flow") {
  Stage scene;
  const auto moved_up = [](const PutMesh& mesh) {
    VertexKeys keys = *mesh.vertices;
    keys.positions = ArrayOf(std::vector<vec3>(3, vec3(0, 0, 1)));
    return PutMesh{.topology = nullptr, .vertices = std::make_shared<const VertexKeys>(keys)};
  };
  MeshTopology morphing = *triangle().topology;
  morphing.morph_count = 1;
  morphing.morph_positions = ArrayOf(std::vector<vec3>(3, vec3(1, 0, 0)));
  const PutMesh soft{.topology = std::make_shared<const MeshTopology>(morphing),
                     .vertices = triangle().vertices};
  scene({named("soft", soft), named("hard", triangle()), named("gone", PutEntity{}),
         named("hand", placed(5)), named("still", showing("soft")), named("ball", placed(1)),
         named("held", placed(2)), named("jumper", placed(3)), named("swapped", showing("hard")),
         named("keyed", PutEntity{.pose = PosePatch{.times = {0, 2}, .matrices = {at(0), at(4)}}}),
         named("morph", showing("soft"))});
  // 0.1 + 0.2 is no sum that a difference gives back.
  scene({anonymous(Advance{0.1}), anonymous(Advance{0.2}), named("ball", placed(9)),
         named("gone", Remove{}), named("new", placed(4)), named("soft", moved_up(soft)),
         named("swapped", showing("soft")), named("held", beneath("hand")),
         named("jumper",
               PutEntity{.pose = PosePatch{.times = {}, .matrices = {at(7)}}, .teleport = true}),
         named("morph", PutEntity{.morph_weights = MorphWeights{{}, {0.5f}}})});
  check_round_trip(*scene.now);
  const auto copy = rebuilt(*scene.now);
  REQUIRE(copy->previous);
  CHECK(copy->time == scene.now->time);
  CHECK(copy->previous->time == scene.now->previous->time);
  for (const char* name :
       {"hand", "still", "ball", "held", "jumper", "swapped", "keyed", "morph", "new"}) {
    INFO(name);
    const u32 i = scene.id(name).index(), k = copy->find(name)->index();
    for (const Time t : {0.1, 0.17, copy->time}) {
      CHECK(local_pose(*copy, k, t) == local_pose(*scene.now, i, t));
      CHECK(flow_valid(*copy, k, copy->time, t) == flow_valid(*scene.now, i, copy->time, t));
      const auto a = deform(*copy, k, t, world_poses(*copy, t));
      const auto b = deform(*scene.now, i, t, world_poses(*scene.now, t));
      REQUIRE(a.has_value() == b.has_value());
      if (a) CHECK(a->positions == b->positions);
    }
  }
  CHECK(local_pose(*copy, copy->find("ball")->index(), 0.1) == at(1));
  CHECK_FALSE(flow_valid(*copy, copy->find("new")->index(), copy->time, 0.1));
  CHECK(flow_valid(*copy, copy->find("held")->index(), copy->time, 0.1));
}

TEST_CASE("describe: an asset's objects serve its next instance after rebuilding too") {
  Asset asset{.hash = std::string(32, 'h'),
              .name = "car",
              .library = {named("shape", triangle()), named("paint", PutMaterial{})},
              .entities = {named("car", showing(CreatedByEdit{0}))}};
  const auto car = std::make_shared<const Asset>(asset);
  Stage scene;
  scene({named("first", Instantiate{.asset = car}), named("car/paint", Remove{})});
  check_round_trip(*scene.now);
  scene.now = rebuilt(*scene.now);
  scene({named("second", Instantiate{.asset = car})});
  CHECK(scene.now->meshes.count() == 1);
  CHECK(scene.entity("second").mesh == scene.id("car/shape"));
  CHECK(scene.has("car/paint"));
  CHECK_FALSE(scene.has("car/shape~2"));
}

TEST_CASE("rebuild: parts that do not fit together are refused") {
  Stage scene;
  scene({named("a", placed(1))});
  SceneDescription damaged = describe(*scene.now);
  damaged.previous.edits = {anonymous(PutSettings{.time = 5})};
  CHECK(rebuild(damaged, {}).error().where == "previous");
  damaged.previous.edits = {{.target = CreatedByEdit{99}, .action = placed(2)}};
  CHECK(rebuild(damaged, {}).error().where == "previous.edits[0].target");
  damaged.previous.edits.clear();
  damaged.libraries = {{.asset = "x", .edits = {99}}};
  CHECK(rebuild(damaged, {}).error().where == "libraries[0].objects[0]");
}
