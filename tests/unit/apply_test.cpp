// apply(): what puts, poses and settings do, and every refusal with the field it names.
#include "renderer/scene/scene.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

TEST_CASE("apply: creates, names and binds in one transaction") {
  Stage scene;
  const auto ids =
      scene({named("tri", triangle()), named("red", PutMaterial{}),
             named("thing", PutEntity{.mesh = CreatedByEdit{0}, .materials = {{"red", Id{}}}}),
             anonymous(beneath("thing"))});
  REQUIRE(ids.size() == 4);
  CHECK(scene.now->revision == 1);
  CHECK(scene.id("thing") == ids[2]);
  CHECK(scene.now->name_of(ids[0]) == "tri");
  CHECK(scene.now->name_of(ids[3]).empty());
  CHECK(scene.entity("thing").mesh == ids[0]);
  CHECK(scene.entity("thing").materials->size() == 2);
  CHECK(scene.entity("thing").children == 1);
  CHECK(scene.now->meshes.at(0).uses == 1);
  CHECK(scene.now->materials.at(0).uses == 1);
}

TEST_CASE("apply: a refused transaction leaves nothing behind") {
  Stage scene;
  scene({named("a", PutEntity{}), named("tri", triangle())});
  const auto before = scene.now;
  const Error error = scene.refuses(
      {named("a", placed(5)), named("b", showing("tri")), named("c", beneath("nobody"))});
  CHECK(error.code == Code::kNotFound);
  CHECK(error.where == "edits[2].entity.parent");
  CHECK(before->poses[0] == mat4x3(1));
  CHECK(before->names.size() == 2);
  CHECK(before->meshes.at(0).uses == 0);
}

TEST_CASE("apply: modes") {
  Stage scene;
  scene({named("a", placed(1))});
  const Id id = scene.id("a");
  CHECK(scene({named("a", placed(2))})[0] == id);
  CHECK(scene({named("a", placed(3), Mode::kUpdate)})[0] == id);
  CHECK(scene({on(id, placed(4))})[0] == id);
  CHECK(scene.pose("a") == at(4));
  CHECK(scene.refuses({named("a", placed(5), Mode::kCreate)}).code == Code::kAlreadyExists);
  CHECK(scene.refuses({on(id, placed(5), Mode::kCreate)}).code == Code::kAlreadyExists);
  CHECK(scene.refuses({named("b", placed(5), Mode::kUpdate)}).code == Code::kNotFound);
  CHECK(scene.refuses({{.mode = Mode::kUpdate, .target = {}, .action = placed(1)}}).code ==
        Code::kInvalidArgument);
  CHECK(scene.refuses({named("", placed(1))}).where == "edits[0].target");
  CHECK(scene.refuses({on(Id{}, placed(1))}).where == "edits[0].target");
}

TEST_CASE("apply: names are unique per kind") {
  Stage scene;
  const std::vector<Action> actions{triangle(), PutMaterial{}, texture(), volume(), PutEntity{}};
  std::vector<Id> ids;
  for (const Action& action : actions) {
    ids.push_back(scene({named("ball", action)})[0]);
    CHECK(scene.refuses({named("ball", action, Mode::kCreate)}).code == Code::kAlreadyExists);
  }
  CHECK(scene.now->names.size() == actions.size());
  for (const Id id : ids) CHECK(scene.now->find("ball", id.kind()) == id);

  SECTION("a field takes the object of its kind") {
    PutEntity entity;
    entity.mesh = Ref("ball");
    scene({named("other", entity)});
    CHECK(scene.now->find(EntityId(*scene.now->find("other")))->mesh == ids[0]);
  }
  SECTION("where any kind will do, entities go first") {
    CHECK(scene.now->find("ball") == ids.back());
    scene({named("ball", Remove{})});
    CHECK(scene.now->find("ball") == ids.front());
    CHECK_FALSE(scene.now->find("ball", Kind::kEntity));
  }
  SECTION("a name that objects of other kinds alone have says so") {
    scene({named("rock", triangle())});
    const Error error = scene.refuses({named("a", beneath("rock"))});
    CHECK(error.code == Code::kInvalidArgument);
    CHECK(error.message == "mesh 'rock' is not of the kind entity");
    CHECK(scene.refuses({named("rock", PutEntity{}, Mode::kUpdate)}).code ==
          Code::kInvalidArgument);
  }
}

TEST_CASE("apply: an unknown name lists the nearest ones") {
  Stage scene;
  scene({named("helmet", PutEntity{}), named("helm", PutEntity{}), named("ground", PutEntity{})});
  const Error error = scene.refuses({named("a", beneath("helmt"))});
  CHECK(error.code == Code::kNotFound);
  REQUIRE(error.nearest.size() == 2);
  CHECK(error.nearest[0] == "helm");
  CHECK(error.nearest[1] == "helmet");
  CHECK(error.message.find("'helmet'") != std::string::npos);
}

TEST_CASE("apply: references of the wrong kind, stale ones, and later edits") {
  Stage scene;
  scene({named("mat", PutMaterial{}), named("old", PutEntity{})});
  const Id old = scene.id("old");
  scene({named("old", Remove{}), named("new", PutEntity{})});
  CHECK(scene.id("new").index() == old.index());

  const auto code_of = [&](Action action, std::string_view where) {
    const Error error = scene.refuses({named("thing", std::move(action))});
    CHECK(error.where == where);
    return error.code;
  };
  CHECK(code_of(showing("mat"), "edits[0].entity.mesh") == Code::kInvalidArgument);
  CHECK(code_of(beneath("mat"), "edits[0].entity.parent") == Code::kInvalidArgument);
  CHECK(code_of(beneath(old), "edits[0].entity.parent") == Code::kNotFound);
  CHECK(code_of(beneath(CreatedByEdit{0}), "edits[0].entity.parent.created_by_edit") ==
        Code::kInvalidArgument);
  CHECK(code_of(PutEntity{.volume = "mat"}, "edits[0].entity.volume") == Code::kInvalidArgument);
  CHECK(code_of(PutEntity{.materials = {{"mat", CreatedByEdit{0}}}},
                "edits[0].entity.materials.parts[1].created_by_edit") == Code::kInvalidArgument);
  CHECK(code_of(PutEntity{.materials = {{"mat", "new"}}}, "edits[0].entity.materials.parts[1]") ==
        Code::kInvalidArgument);
  CHECK(code_of(PutEntity{.light = {LightPatch{.texture = {.texture = "mat", .use = {}}}}},
                "edits[0].entity.light.texture.texture") == Code::kInvalidArgument);
  CHECK(code_of(textured("mat"), "edits[0].material.base_color.texture.texture") ==
        Code::kInvalidArgument);
  CHECK(scene.refuses({on(old, placed(1))}).code == Code::kNotFound);
  CHECK(scene.refuses({on(Id::make(Kind::kMesh, 1, 99), triangle())}).code == Code::kNotFound);
  const Error settings = scene.refuses({anonymous(PutSettings{.dome = PutDome{.texture = "mat"}})});
  CHECK(settings.where == "edits[0].settings.dome.texture");
  const Error no_object =
      scene.refuses({anonymous(Prune{}), named("t", beneath(CreatedByEdit{0}))});
  CHECK(no_object.code == Code::kInvalidArgument);
}

TEST_CASE("apply: an object removed by an earlier edit of the transaction is gone") {
  Stage scene;
  scene({named("a", PutEntity{})});
  const Error error = scene.refuses(
      {on(scene.id("a"), placed(1)), named("a", Remove{}), named("b", beneath(CreatedByEdit{0}))});
  CHECK(error.code == Code::kNotFound);
}

TEST_CASE("apply: what makes no sense together") {
  Stage scene;
  scene({named("tri", triangle()), named("fog", volume()), named("a", showing("tri")),
         named("b", beneath("a")), named("c", beneath("b"))});
  const auto refuses = [&](Edit edit, std::string_view where) {
    const Error error = scene.refuses({std::move(edit)});
    CHECK(error.code == Code::kInvalidArgument);
    CHECK(error.where == where);
  };
  refuses(named("a", PutEntity{.volume = "fog"}), "edits[0].entity.volume");
  refuses(named("n", PutEntity{.mesh = "tri", .volume = "fog"}), "edits[0].entity.volume");
  refuses(named("a", beneath("c")), "edits[0].entity.parent");
  refuses(named("a", beneath("a")), "edits[0].entity.parent");
  refuses(named("tri", PutMesh{.topology = triangle(4).topology}), "edits[0].mesh.positions");
  refuses(named("tri", PutMesh{.vertices = triangle(4).vertices}), "edits[0].mesh.positions");
  refuses(named("m", PutMesh{.vertices = triangle().vertices}), "edits[0].mesh.indices");
  refuses(named("m", PutMesh{.topology = triangle().topology}), "edits[0].mesh.positions");
  refuses(named("t", PutTexture{}), "edits[0].texture.texels");
  refuses(named("v", PutVolume{}), "edits[0].volume.density");
  refuses(anonymous(Advance{.dt = 0}), "edits[0].advance.dt");
  refuses(named("x", Advance{.dt = 1}), "edits[0].target");
  refuses(named("a", PutEntity{.pose = PosePatch{.times = {1, 1}, .matrices = {at(0), at(1)}}}),
          "edits[0].entity.pose.times");
  refuses(named("a", PutEntity{.pose = PosePatch{.times = {1, 2}, .matrices = {at(0)}}}),
          "edits[0].entity.pose.matrices");
  VertexKeys no_normals = *triangle().vertices;
  no_normals.normals = ArrayOf(std::vector<vec3>(2));
  refuses(named("tri", PutMesh{.vertices = std::make_shared<const VertexKeys>(no_normals)}),
          "edits[0].mesh.normals");
  // What was legal stays so: the mesh gives way to the volume.
  scene({named("a", PutEntity{.mesh = Id{}, .volume = "fog"})});
  CHECK(scene.now->meshes.at(0).uses == 0);
  CHECK(scene.now->volumes.at(0).uses == 1);
}

TEST_CASE("apply: skins and morph weights fit their mesh") {
  Stage scene;
  MeshTopology skinned = *triangle().topology;
  skinned.joints = ArrayOf<glm::u16vec4>(std::vector<glm::u16vec4>(3, {0, 1, 0, 0}));
  skinned.weights = ArrayOf<vec4>(std::vector<vec4>(3, {0.5f, 0.5f, 0, 0}));
  skinned.morph_count = 2;
  const PutMesh body{.topology = std::make_shared<const MeshTopology>(skinned),
                     .vertices = triangle().vertices};
  scene({named("body", body), named("tri", triangle()), named("j", PutEntity{})});
  const auto skin = [](std::size_t joints) {
    return SkinPatch{.joints = std::vector<Ref>(joints, "j"),
                     .inverse_binds = std::vector<mat4x3>(joints, mat4x3(1))};
  };
  const auto refuses = [&](PutEntity put, std::string_view where) {
    const Error error = scene.refuses({named("man", std::move(put))});
    CHECK(error.code == Code::kInvalidArgument);
    CHECK(error.where == where);
  };
  refuses({.mesh = "tri", .skin = {skin(2)}}, "edits[0].entity.skin");
  refuses({.mesh = "body", .skin = {skin(1)}}, "edits[0].entity.skin.joints");
  refuses({.mesh = "body", .skin = {skin(0)}}, "edits[0].entity.skin.joints");
  SkinPatch short_of_binds = skin(2);
  short_of_binds.inverse_binds.pop_back();
  refuses({.mesh = "body", .skin = {short_of_binds}}, "edits[0].entity.skin.inverse_binds");
  refuses({.mesh = "body", .morph_weights = {MorphWeights{{}, {1}}}},
          "edits[0].entity.morph_weights.weights");
  refuses({.mesh = "body", .morph_weights = {MorphWeights{{0, 1}, {1, 2, 3}}}},
          "edits[0].entity.morph_weights.weights");
  scene({named("man", PutEntity{.mesh = "body",
                                .skin = {skin(2)},
                                .morph_weights = {MorphWeights{{0, 1}, {1, 2, 3, 4}}}})});
  CHECK(scene.entity("j").skins == 2);
  // A mesh that no longer fits those who show it is refused.
  CHECK(scene.refuses({named("body", triangle())}).code == Code::kInvalidArgument);
  scene({named("man", PutEntity{.skin = std::optional<SkinPatch>(),
                                .morph_weights = std::optional<MorphWeights>()}),
         named("body", triangle())});
  CHECK(scene.entity("j").skins == 0);
}

TEST_CASE("apply: a put changes the fields it has and no others") {
  Stage scene;
  scene({named("t", texture()), named("m", textured("t")),
         named("a", PutEntity{.pose = PosePatch{.times = {}, .matrices = {at(1)}},
                              .materials = {{"m"}},
                              .camera = {Camera{.width = 4, .height = 3}},
                              .visible = false,
                              .attributes = Attributes{{"k", "v"}}})});
  CHECK(scene.now->textures.at(0).uses == 1);
  CHECK(scene.now->textures.at(0).value->srgb);
  PutMaterial rough;
  rough.parameters[std::size_t(MaterialParameter::roughness)].value = vec3(0.25f);
  scene({named("m", rough), named("a", PutEntity{.visible = true}),
         named("t", PutTexture{.wrap_u = Wrap::kClamp})});
  const Material& material = *scene.now->materials.at(0).value;
  CHECK(material[MaterialParameter::roughness].value.x == 0.25f);
  CHECK(material[MaterialParameter::base_color].value.x == 0.8f);
  CHECK(material[MaterialParameter::base_color].texture.texture == scene.id("t"));
  CHECK(scene.entity("a").camera->width == 4);
  CHECK(scene.entity("a").attributes->at("k") == "v");
  CHECK(scene.pose("a") == at(1));
  CHECK(scene.now->textures.at(0).value->image);
  scene({named("m", textured(Id{})), named("a", PutEntity{.camera = std::optional<Camera>()})});
  CHECK(scene.now->textures.at(0).uses == 0);
  CHECK_FALSE(scene.entity("a").camera);
}

TEST_CASE("apply: keys follow the time, a constant pose clears them") {
  Stage scene;
  const PosePatch keys{.times = {0, 2}, .matrices = {at(0), at(4)}};
  scene({named("a", PutEntity{.pose = keys})});
  CHECK(scene.now->keyed == 1);
  CHECK(scene.pose("a") == at(0));
  scene({anonymous(PutSettings{.time = 1})});
  CHECK(scene.pose("a") == at(2));
  scene({anonymous(Advance{.dt = 1})});
  CHECK(scene.pose("a") == at(4));
  CHECK(scene.now->previous->poses[0] == at(2));
  scene({named("a", placed(9))});
  CHECK(scene.now->keyed == 0);
  CHECK_FALSE(scene.entity("a").keys);
  CHECK(scene.pose("a") == at(9));
}

TEST_CASE("apply: what comes before an advance belongs to the old time") {
  Stage scene;
  scene({named("a", placed(1)), named("b", placed(1))});
  PutEntity jump = placed(3);
  jump.teleport = true;
  scene({named("a", placed(2)), named("b", jump), anonymous(Advance{.dt = 0.5}),
         named("a", placed(3))});
  CHECK(scene.now->time == 0.5);
  CHECK(scene.now->previous->time == 0);
  CHECK(scene.now->previous->poses[0] == at(2));
  CHECK(scene.pose("a") == at(3));
  CHECK(scene.entity("b").teleported != scene.now->advances);
  scene({named("b", jump)});
  CHECK(scene.entity("b").teleported == scene.now->advances);
  scene({anonymous(Advance{.dt = 1})});
  CHECK(scene.now->previous->time == 0.5);
  CHECK_FALSE(scene.now->previous->previous);
  scene({anonymous(PutSettings{.time = 0})});
  CHECK_FALSE(scene.now->previous);
}

TEST_CASE("apply: instances share everything, have names and labels of their own") {
  Stage scene;
  auto prepared = apply(*scene.now,
                        {{named("tri", triangle()), named("m", PutMaterial{}),
                          named("p", Instances{.prototype = {.mesh = "tri", .materials = {{"m"}}},
                                               .matrices = {at(0), at(1), at(2)}})}},
                        scene.limits);
  REQUIRE(prepared);
  CHECK(prepared->counts == std::vector<u32>{0, 0, 3});
  REQUIRE(prepared->ids.size() == 6);
  CHECK_FALSE(prepared->ids[2]);
  scene.now = prepared->snapshot;
  CHECK(scene.id("p/2") == prepared->ids[5]);
  CHECK(scene.pose("p/2") == at(2));
  CHECK(scene.entity("p/0").label.value == 1);
  CHECK(scene.entity("p/2").label.value == 3);
  CHECK(scene.entity("p/0").materials == scene.entity("p/2").materials);
  CHECK(scene.now->meshes.at(0).uses == 3);
  CHECK(scene.now->materials.at(0).uses == 3);
  const auto one = [](PutEntity prototype) {
    return Instances{.prototype = std::move(prototype), .matrices = {at(0), at(1)}};
  };
  CHECK(scene.refuses({named("p", one({}))}).where == "edits[0].target");
  CHECK(scene.refuses({named("q", one(placed(1)))}).where == "edits[0].instances.prototype.pose");
  CHECK(scene.refuses({named("q", one(showing("m")))}).where ==
        "edits[0].instances.prototype.mesh");
  CHECK(scene.refuses({named("q", one(labelled(9)))}).where ==
        "edits[0].instances.prototype.label");
  CHECK(scene({anonymous(one(labelled(9, true)))}).size() == 3);
}

namespace {

Poses poses(std::vector<Id> ids, std::vector<mat4x3> matrices) {
  return {ArrayOf(std::move(ids)), ArrayOf(std::move(matrices))};
}

}  // namespace

TEST_CASE("apply: poses of many") {
  Stage scene;
  scene({named("a", PutEntity{.pose = PosePatch{.times = {0, 1}, .matrices = {at(0), at(1)}}}),
         named("b", PutEntity{}), named("m", PutMaterial{})});
  const Id a = scene.id("a"), b = scene.id("b");
  scene({anonymous(poses({a, b}, {at(5), at(6)}))});
  CHECK(scene.pose("a") == at(5));
  CHECK(scene.pose("b") == at(6));
  CHECK_FALSE(scene.entity("a").keys);
  const Error kind = scene.refuses({anonymous(poses({a, scene.id("m")}, {at(0), at(1)}))});
  CHECK(kind.code == Code::kInvalidArgument);
  CHECK(kind.where == "edits[0].poses.ids[1]");
  CHECK(scene.refuses({anonymous(poses({a}, {at(0), at(1)}))}).where == "edits[0].poses.matrices");
  scene({named("b", Remove{})});
  CHECK(scene.refuses({anonymous(poses({a, b}, {at(0), at(1)}))}).code == Code::kNotFound);
}

TEST_CASE("apply: new vertices alone say that a mesh took another shape") {
  Stage scene;
  const auto is_reshaped = [&] { return scene.now->meshes.at(0).value->reshaped; };
  scene({named("tri", triangle())});
  CHECK_FALSE(is_reshaped());
  scene({named("tri", PutMesh{.topology = nullptr, .vertices = triangle().vertices})});
  CHECK(is_reshaped());
  scene({named("tri", triangle())});
  CHECK_FALSE(is_reshaped());
}

TEST_CASE("apply: limits name what is needed and what there is") {
  Stage scene;
  scene.limits = {.entities = 2, .array_bytes = 100};
  scene({named("a", PutEntity{}), named("tri", triangle())});
  const Error entities = scene.refuses({named("b", PutEntity{}), named("c", PutEntity{})});
  CHECK(entities.code == Code::kResourceExhausted);
  CHECK(entities.needed == 3);
  CHECK(entities.available == 2);
  CHECK(entities.where == "edits[1].entity");
  const PutMesh same{.topology = scene.now->meshes.at(0).value->topology,
                     .vertices = scene.now->meshes.at(0).value->vertices};
  scene({named("again", same), named("and again", same)});  // shared arrays count once
  CHECK(array_bytes(*scene.now) == 48);
  CHECK(scene.refuses({named("b", triangle()), named("c", triangle())}).code ==
        Code::kResourceExhausted);
}

TEST_CASE("apply: an untouched chunk is shared, and a branch is its own") {
  Stage scene;
  std::vector<mat4x3> matrices(1000, mat4x3(1));
  scene({named("p", Instances{.prototype = {}, .matrices = matrices})});
  Stage branch = scene;
  branch({named("p/300", placed(7))});
  CHECK(branch.now->entities.same(scene.now->entities));
  CHECK(branch.now->meshes.same(scene.now->meshes));
  u32 rows = 0;
  branch.now->poses.for_each_changed(scene.now->poses, [&](u32) { ++rows; });
  CHECK(rows == 256);
  CHECK(scene.pose("p/300") == mat4x3(1));
  scene({named("p/300", Remove{})});
  CHECK(branch.has("p/300"));
  CHECK(branch.pose("p/300") == at(7));
  // The same values again change nothing.
  Stage idle = branch;
  idle({named("p/300", placed(7))});
  CHECK(idle.now->poses.same(branch.now->poses));
  CHECK(idle.now->entities.same(branch.now->entities));
}
