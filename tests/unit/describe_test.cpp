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
  Stage fresh;
  fresh(describe(snapshot).edits);
  return fresh.now;
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
                 .attributes = Attributes{{"k", "v"}}};
  body.light = LightPatch{.light = {.intensity = 3, .unit = LightUnit::kLumen},
                          .texture = {.texture = "image", .use = {.offset = 1}}};
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
                                               .camera_visible = false}})});
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
