// Removal: refused while in use, cascades, prune. Counts stay exact.
#include "renderer/scene/scene.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

Remove cascade() { return {.cascade = true}; }

/// A chair of three entities with everything on it, and a lamp that shares its mesh.
Stage furnished() {
  Stage scene;
  PutEntity chair{.mesh = "seat", .materials = {{"wood", "cloth"}}};
  chair.light = LightPatch{.light = {}, .texture = {.texture = "glow", .use = {}}};
  scene({named("grain", texture()), named("glow", texture()), named("wood", textured("grain")),
         named("cloth", textured("grain")), named("seat", triangle()), named("smoke", volume()),
         named("chair", chair), named("leg", beneath("chair")), named("foot", beneath("leg")),
         named("lamp", PutEntity{.mesh = "seat", .materials = {{"wood"}}}),
         named("fire", PutEntity{.parent = "lamp", .volume = "smoke"}),
         anonymous(PutSettings{.dome = PutDome{.texture = "glow"}})});
  return scene;
}

}  // namespace

TEST_CASE("remove: what is in use is refused, and its users are listed") {
  const Stage scene = furnished();
  const auto users = [&](const char* name) {
    const Error error = scene.refuses({named(name, Remove{})});
    CHECK(error.code == Code::kFailedPrecondition);
    CHECK(error.where == "edits[0].remove");
    return error.users;
  };
  using Users = std::vector<std::string>;
  CHECK(users("chair") == Users{"entity 'leg'"});
  CHECK(users("seat") == Users{"entity 'chair'", "entity 'lamp'"});
  CHECK(users("cloth") == Users{"entity 'chair'"});
  CHECK(users("smoke") == Users{"entity 'fire'"});
  CHECK(users("grain") == Users{"material 'wood'", "material 'cloth'"});
  CHECK(users("glow") == Users{"entity 'chair'", "the dome"});
}

TEST_CASE("remove: an entity releases what it used") {
  Stage scene = furnished();
  scene({named("foot", Remove{}), named("leg", Remove{}), named("chair", Remove{})});
  CHECK(scene.now->entities.count() == 2);
  CHECK_FALSE(scene.has("chair"));
  CHECK(scene.now->find(MeshId(scene.id("seat")))->uses == 1);
  CHECK(scene.now->find(MaterialId(scene.id("cloth")))->uses == 0);
  CHECK(scene.now->find(TextureId(scene.id("glow")))->uses == 1);
  CHECK(scene.now->labels.size() == 1);
  scene({named("cloth", Remove{})});
  CHECK(scene.now->find(TextureId(scene.id("grain")))->uses == 1);
}

TEST_CASE("remove: cascade takes the whole subtree") {
  Stage scene = furnished();
  const auto ids = scene({named("chair", cascade())});
  CHECK_FALSE(ids[0]);
  CHECK(scene.now->entities.count() == 2);
  for (const char* name : {"chair", "leg", "foot"}) CHECK_FALSE(scene.has(name));
  CHECK(scene.now->find(MeshId(scene.id("seat")))->uses == 1);
}

TEST_CASE("remove: cascade unbinds a shared object where it is used") {
  Stage scene = furnished();
  scene({named("seat", cascade()), named("wood", cascade()), named("smoke", cascade()),
         named("glow", cascade())});
  CHECK_FALSE(scene.entity("chair").mesh);
  CHECK_FALSE(scene.entity("lamp").mesh);
  CHECK_FALSE(scene.entity("fire").volume);
  CHECK_FALSE((*scene.entity("chair").materials)[0]);
  CHECK((*scene.entity("chair").materials)[1] == scene.id("cloth"));
  CHECK_FALSE(scene.entity("chair").light->texture.texture);
  CHECK_FALSE(scene.now->dome->texture);
  CHECK(scene.now->find(TextureId(scene.id("grain")))->uses == 1);
  scene({named("grain", cascade())});
  const auto& cloth = *scene.now->find(MaterialId(scene.id("cloth")))->value;
  CHECK_FALSE(cloth[MaterialParameter::base_color].texture.texture);
}

TEST_CASE("remove: a joint is refused, or takes the skin off") {
  Stage scene;
  const auto skin = [](Ref joint) {
    return PutEntity{.skin = SkinPatch{.joints = {std::move(joint)}, .inverse_binds = {mat4x3(1)}}};
  };
  scene({named("bone", PutEntity{}), named("tip", beneath("bone")), named("man", skin("tip")),
         named("self", PutEntity{})});
  scene({named("self", skin("self"))});
  CHECK(scene.refuses({named("tip", Remove{})}).users == std::vector<std::string>{"entity 'man'"});
  scene({named("bone", cascade())});
  CHECK_FALSE(scene.entity("man").skin);
  scene({named("self", Remove{})});
  CHECK(scene.now->entities.count() == 1);
}

TEST_CASE("remove: needs something to remove") {
  const Stage scene = furnished();
  CHECK(scene.refuses({anonymous(Remove{})}).where == "edits[0].target");
  CHECK(scene.refuses({on(Id{}, Remove{})}).where == "edits[0].target");
  CHECK(scene.refuses({named("chari", Remove{})}).nearest.at(0) == "chair");
  CHECK(scene.refuses({named("foot", Remove{}, Mode::kCreate)}).where == "edits[0].mode");
}

TEST_CASE("remove: many users are counted, few are named") {
  Stage scene;
  scene({named("tri", triangle()),
         named("p", Instances{.prototype = showing("tri"), .matrices = {100, mat4x3(1)}})});
  const Error error = scene.refuses({named("tri", Remove{})});
  CHECK(error.users.size() == 16);
  CHECK(error.message.find("100 objects") != std::string::npos);
}

TEST_CASE("prune: removes what nobody uses, and what only that used") {
  Stage scene = furnished();
  scene({named("chair", cascade()), anonymous(Prune{})});
  CHECK(scene.has("seat"));
  CHECK(scene.has("wood"));
  CHECK(scene.has("grain"));
  CHECK(scene.has("glow"));
  CHECK_FALSE(scene.has("cloth"));
  scene({named("lamp", cascade()), anonymous(Prune{})});
  CHECK(scene.now->names.size() == 1);  // the dome's texture
  CHECK(scene.now->array_bound == 4);
}
