// Placing assets: the library once, entities each time, names, overrides, animation.
#include "renderer/scene/scene.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

/// library: 0 texture, 1 material, 2 mesh; entities: 3 root, 4 body, 5 wheel.
std::shared_ptr<Asset> car() {
  auto asset = std::make_shared<Asset>();
  asset->hash = std::string(32, 'h');
  asset->name = "car";
  asset->library = {named("paint.png", texture()), named("paint", textured(CreatedByEdit{0})),
                    named("shape", triangle())};
  asset->entities = {
      named("car", placed(1)),
      named("body", PutEntity{.parent = CreatedByEdit{3},
                              .mesh = CreatedByEdit{2},
                              .materials = {{CreatedByEdit{1}}}}),
      named("wheel", PutEntity{.mesh = CreatedByEdit{2}, .materials = {{CreatedByEdit{1}}}})};
  asset->animations = {
      {.name = "drive",
       .channels = {
           {.entity = 2, .keys = PosePatch{.times = {0, 1}, .matrices = {at(0), at(2)}}}}}};
  return asset;
}
Instantiate copy_of(std::shared_ptr<const Asset> asset) { return {.asset = std::move(asset)}; }

}  // namespace

TEST_CASE("instantiate: a copy has a root, a label, names beneath it, and a shared library") {
  Stage scene;
  auto prepared = apply(*scene.now, {{named("first", copy_of(car()))}}, scene.limits);
  REQUIRE(prepared);
  scene.now = prepared->snapshot;
  CHECK(prepared->counts == std::vector<u32>{5});
  const std::vector<Id> expected{scene.id("first"),       scene.id("first/body"),
                                 scene.id("first/wheel"), scene.id("car/paint.png"),
                                 scene.id("car/paint"),   scene.id("car/shape")};
  CHECK(prepared->ids == expected);
  CHECK(scene.entity("first").label.value == 1);
  CHECK_FALSE(scene.entity("first/body").label.set);
  CHECK(scene.entity("first/wheel").parent == scene.id("first"));
  CHECK(scene.pose("first") == at(1));

  const auto again = scene({named("second", copy_of(car()))});
  CHECK(again[3] == expected[3]);
  CHECK(again[5] == expected[5]);
  CHECK(scene.now->meshes.count() == 1);
  CHECK(scene.now->meshes.at(0).uses == 4);
  CHECK(scene.entity("second").label.value == 2);
}

TEST_CASE("instantiate: the caller's parent, pose, label and materials win") {
  Stage scene;
  LabelPatch label{.category = "vehicle"};
  scene({named("road", PutEntity{}), named("red", PutMaterial{}),
         named("c", Instantiate{.asset = car(),
                                .parent = "road",
                                .pose = PosePatch{.times = {}, .matrices = {at(7)}},
                                .label = label,
                                .materials = {{"paint", "red"}}}),
         named("d", copy_of(car()))});
  CHECK(scene.entity("c").parent == scene.id("road"));
  CHECK(scene.pose("c") == at(7));
  CHECK(scene.entity("c").label.value == 1);
  CHECK(scene.entity("c").label.category == 1);
  CHECK((*scene.entity("c/body").materials)[0] == scene.id("red"));
  CHECK((*scene.entity("d/body").materials)[0] == scene.id("car/paint"));
  scene({named(
      "e", Instantiate{.asset = car(), .label = LabelPatch{.kind = LabelPatch::Kind::kValue}})});
  CHECK(scene.entity("e").label.set);
  CHECK(scene.entity("e").label.value == 0);
}

TEST_CASE("instantiate: an animation gives keys to this copy") {
  Stage scene;
  scene({named("a", Instantiate{.asset = car(), .animation = 0}), named("b", copy_of(car()))});
  CHECK(scene.entity("a/wheel").keys->size() == 2);
  CHECK_FALSE(scene.entity("b/wheel").keys);
  CHECK(scene.refuses({named("c", Instantiate{.asset = car(), .animation = 1})}).where ==
        "edits[0].instantiate.animation");
}

TEST_CASE("instantiate: names that are taken get a suffix, the root's is refused") {
  Stage scene;
  scene(
      {named("car/paint", PutEntity{}), named("a/body", PutEntity{}), named("a", copy_of(car()))});
  CHECK(scene.has("car/paint~2"));
  CHECK(scene.entity("a/body~2").parent == scene.id("a"));
  CHECK(scene.refuses({named("a", copy_of(car()))}).code == Code::kAlreadyExists);
  CHECK(scene.refuses({on(scene.id("a"), copy_of(car()))}).where == "edits[0].target");
  CHECK(scene.refuses({named("n", copy_of(car()), Mode::kUpdate)}).where == "edits[0].mode");
  const auto ids = scene({anonymous(copy_of(car()))});
  CHECK(scene.now->name_of(ids[0]).empty());
  CHECK(scene.now->name_of(ids[1]).empty());
}

TEST_CASE("instantiate: what was removed from the library comes back, what was edited stays") {
  Stage scene;
  scene({named("a", copy_of(car()))});
  const Id mesh = scene.id("car/shape"), paint = scene.id("car/paint");
  PutMaterial matt;
  matt.parameters[std::size_t(MaterialParameter::roughness)].value = vec3(1);
  scene({named("car/paint", matt), named("car/shape", Remove{.cascade = true})});
  scene({named("b", copy_of(car()))});
  CHECK(scene.id("car/shape") != mesh);
  CHECK(scene.entity("b/body").mesh == scene.id("car/shape"));
  CHECK((*scene.entity("b/body").materials)[0] == paint);
  CHECK((*scene.now->find(MaterialId(paint))->value)[MaterialParameter::roughness].value.x == 1);
}

TEST_CASE("instantiate: bad overrides and malformed assets are refused with the field") {
  Stage scene;
  scene({named("x", PutEntity{})});
  const auto refuses = [&](Instantiate action, Code code, std::string_view where) {
    const Error error = scene.refuses({named("a", std::move(action))});
    CHECK(error.code == code);
    CHECK(error.where == where);
    return error;
  };
  const Error unknown = refuses({.asset = car(), .materials = {{"pain", "x"}}},
                                Code::kInvalidArgument, "edits[0].instantiate.materials['pain']");
  const Error nearest = refuses({.asset = car(), .materials = {{"pain", Id{}}}}, Code::kNotFound,
                                "edits[0].instantiate.materials['pain']");
  CHECK(nearest.nearest == std::vector<std::string>{"paint"});
  refuses({.asset = car(), .parent = "nobody"}, Code::kNotFound, "edits[0].instantiate.parent");
  refuses({}, Code::kInvalidArgument, "edits[0].instantiate.asset");
  auto by_name = car();
  std::get<PutEntity>(by_name->entities[1].action).mesh = Ref("x");
  refuses({.asset = by_name}, Code::kInvalidArgument,
          "edits[0].instantiate.asset.entities[1].mesh");
  auto forward = car();
  forward->library[1].action = textured(CreatedByEdit{2});
  refuses({.asset = forward}, Code::kInvalidArgument,
          "edits[0].instantiate.asset.library[1].base_color.texture.texture.created_by_edit");
  auto nested = car();
  nested->library[0].action = copy_of(car());
  refuses({.asset = nested}, Code::kInvalidArgument, "edits[0].instantiate.asset.library[0]");
  CHECK(scene.now->names.size() == 1);
}
