// Random transactions against a model made of maps: which are refused, what the scene holds after,
// and that every count is exact.
#include <map>
#include <random>
#include <set>

#include "renderer/scene/scene.h"
#include "tests/unit/dump.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

/// Objects by name; references are names, "" for nothing. Slow and simple.
struct Model {
  struct Thing {
    std::string parent, mesh, light;
    std::vector<std::string> materials, joints;
    friend bool operator==(const Thing&, const Thing&) = default;
  };
  std::map<std::string, Thing> entities;
  std::map<std::string, std::string> materials;  // -> texture
  std::set<std::string> meshes, textures;

  [[nodiscard]] bool beneath(std::string name, const std::string& ancestor) const {
    for (; !name.empty(); name = entities.at(name).parent)
      if (name == ancestor) return true;
    return false;
  }
  [[nodiscard]] u32 uses(const std::string& name) const {
    u32 n = 0;
    for (const auto& [user, e] : entities) {
      n += (e.mesh == name) + (e.light == name);
      n += u32(std::ranges::count(e.materials, name));
    }
    for (const auto& [user, texture] : materials) n += texture == name;
    return n;
  }
  [[nodiscard]] u32 children(const std::string& name) const {
    u32 n = 0;
    for (const auto& [child, e] : entities) n += e.parent == name;
    return n;
  }
  [[nodiscard]] u32 joints(const std::string& name, bool of_others) const {
    u32 n = 0;
    for (const auto& [user, e] : entities)
      if (!of_others || user != name) n += u32(std::ranges::count(e.joints, name));
    return n;
  }
  [[nodiscard]] bool has(const std::string& name) const {
    return entities.contains(name) || materials.contains(name) || meshes.contains(name) ||
           textures.contains(name);
  }

  void unbind(const std::string& name) {
    for (auto& [user, e] : entities) {
      if (e.mesh == name) e.mesh = "";
      if (e.light == name) e.light = "";
      std::ranges::replace(e.materials, name, std::string());
      if (std::ranges::find(e.joints, name) != e.joints.end()) e.joints.clear();
    }
    for (auto& [user, texture] : materials)
      if (texture == name) texture = "";
  }
  bool remove(const std::string& name, bool cascade) {
    if (!has(name)) return false;
    if (!cascade && (uses(name) || children(name) || joints(name, true))) return false;
    std::vector<std::string> gone{name};
    if (entities.contains(name))
      for (const auto& [other, e] : entities)
        if (other != name && beneath(other, name)) gone.push_back(other);
    for (const std::string& each : gone) {
      entities.erase(each);
      materials.erase(each);
      meshes.erase(each);
      textures.erase(each);
    }
    for (const std::string& each : gone) unbind(each);
    return true;
  }
  void prune() {
    std::erase_if(meshes, [&](const auto& name) { return uses(name) == 0; });
    std::erase_if(materials, [&](const auto& m) { return uses(m.first) == 0; });
    std::erase_if(textures, [&](const auto& name) { return uses(name) == 0; });
  }
};

class Fuzz {
 public:
  explicit Fuzz(u32 seed) : random_(seed) {}

  /// One random edit, carried out in `model` too; nullopt when the model refuses it.
  std::pair<Edit, bool> edit(Model& model) {
    switch (below(10)) {
      case 0:
        return mesh(model);
      case 1:
        return texture_edit(model);
      case 2:
        return material(model);
      case 3:
      case 4:
        return removal(model);
      case 5:
        if (below(4)) return entity(model);
        model.prune();
        return {anonymous(Prune{}), true};
      default:
        return entity(model);
    }
  }
  u32 below(u32 n) { return u32(random_() % n); }

 private:
  std::string name(const char* kind) { return fmt::format("{}{}", kind, below(6)); }
  /// A name, or nothing.
  std::string maybe(const char* kind) { return below(4) ? name(kind) : std::string(); }
  static Ref ref(const std::string& name) { return name.empty() ? Ref(Id{}) : Ref(name); }

  std::pair<Edit, bool> mesh(Model& model) {
    const std::string target = name("mesh");
    model.meshes.insert(target);
    return {named(target, triangle()), true};
  }
  std::pair<Edit, bool> texture_edit(Model& model) {
    const std::string target = name("texture");
    model.textures.insert(target);
    return {named(target, texture()), true};
  }
  std::pair<Edit, bool> material(Model& model) {
    const std::string target = name("material"), image = maybe("texture");
    const bool fine = image.empty() || model.textures.contains(image);
    if (fine) model.materials[target] = image;
    return {named(target, textured(ref(image))), fine};
  }
  std::pair<Edit, bool> removal(Model& model) {
    constexpr std::array kKinds{"entity", "mesh", "texture", "material"};
    const std::string target = name(kKinds[below(4)]);
    const bool cascade = below(2);
    return {named(target, Remove{.cascade = cascade}), model.remove(target, cascade)};
  }
  std::pair<Edit, bool> entity(Model& model) {
    const std::string target = name("entity");
    const bool fresh = !model.entities.contains(target);
    Model::Thing thing = fresh ? Model::Thing{} : model.entities[target];
    PutEntity patch{.label = LabelPatch{.kind = LabelPatch::Kind::kValue}};
    bool fine = true;
    const auto take = [&](std::string& field, const char* kind, const auto& known) {
      field = maybe(kind);
      fine &= field.empty() || known.contains(field);
      return ref(field);
    };
    if (below(2)) {
      patch.parent = take(thing.parent, "entity", model.entities);
      fine &= fine && !(thing.parent == target) &&
              (thing.parent.empty() || fresh || !model.beneath(thing.parent, target));
    }
    if (below(2)) patch.mesh = take(thing.mesh, "mesh", model.meshes);
    if (below(3) == 0) {
      LightPatch light;
      (below(2) ? light.profile : light.texture.texture) =
          take(thing.light, "texture", model.textures);
      patch.light = light;
    }
    if (below(2)) {
      thing.materials.assign(below(3), "");
      patch.materials.emplace();
      for (auto& one : thing.materials)
        patch.materials->push_back(take(one, "material", model.materials));
    }
    fine &= set_joints(model, target, thing, patch);
    if (fine) model.entities[target] = thing;
    return {named(target, patch), fine};
  }
  /// A skin, which no mesh here can follow; it may name the entity itself, also a new one.
  bool set_joints(const Model& model, const std::string& self, Model::Thing& thing,
                  PutEntity& patch) {
    if (below(3) == 0) {
      thing.joints.assign(below(3), "");
      patch.skin.emplace(std::nullopt);
      if (!thing.joints.empty()) patch.skin->emplace();
      for (auto& joint : thing.joints) {
        joint = name("entity");
        (*patch.skin)->joints.emplace_back(joint);
        (*patch.skin)->inverse_binds.emplace_back(1);
      }
    }
    return std::ranges::all_of(thing.joints,
                               [&](const auto& joint) {
                                 return joint == self || model.entities.contains(joint);
                               }) &&
           (thing.joints.empty() || thing.mesh.empty() || !(patch.mesh || patch.skin));
  }
  std::mt19937 random_;
};

void check_entity(const Snapshot& scene, const Model& model, const std::string& name) {
  const Entity& e = *scene.find(EntityId(scene.find(name).value()));
  Model::Thing found{
      .parent = scene.name_of(e.parent),
      .mesh = scene.name_of(e.mesh),
      .light =
          e.light ? scene.name_of(e.light->texture.texture) + scene.name_of(e.light->profile) : "",
      .materials = {},
      .joints = {}};
  if (e.materials)
    for (const Id id : *e.materials) found.materials.push_back(scene.name_of(id));
  if (e.skin)
    for (const Id id : e.skin->joints) found.joints.push_back(scene.name_of(id));
  REQUIRE(found == model.entities.at(name));
  REQUIRE(e.children == model.children(name));
  REQUIRE(e.skins == model.joints(name, false));
}

template <class T>
void check_uses(const Snapshot& scene, const Table<Shared<T>>& table, const Model& model) {
  table.for_each([&](u32, const Shared<T>& row) {
    REQUIRE(scene.names.find(*row.name, Kind::kNone));
    REQUIRE(row.uses == model.uses(*row.name));
  });
}

void check(const Snapshot& scene, const Model& model) {
  REQUIRE(scene.entities.count() == model.entities.size());
  REQUIRE(scene.meshes.count() == model.meshes.size());
  REQUIRE(scene.materials.count() == model.materials.size());
  REQUIRE(scene.textures.count() == model.textures.size());
  REQUIRE(scene.names.size() == model.entities.size() + model.meshes.size() +
                                    model.materials.size() + model.textures.size());
  for (const auto& [name, thing] : model.entities) check_entity(scene, model, name);
  for (const auto& [name, image] : model.materials) {
    const auto& row = *scene.find(MaterialId(scene.find(name).value()));
    REQUIRE(scene.name_of(row.value->parameters[0].texture.texture) == image);
  }
  check_uses(scene, scene.meshes, model);
  check_uses(scene, scene.materials, model);
  check_uses(scene, scene.textures, model);
  REQUIRE(scene.array_bound == array_bytes(scene));  // nothing is shared here
  for (u32 i = 0; i < scene.poses.size(); ++i) REQUIRE(scene.poses[i] == mat4x3(1));
}

}  // namespace

TEST_CASE("fuzz: random transactions do what a simple model does") {
  u32 refused = 0, accepted = 0;
  for (u32 seed = 0; seed < 20; ++seed) {
    Fuzz fuzz(seed);
    Stage scene;
    Model model;
    std::vector<std::pair<std::shared_ptr<const Snapshot>, std::string>> history;
    for (u32 step = 0; step < 300; ++step) {
      Model next = model;
      Transaction transaction;
      bool fine = true;
      for (u32 k = fuzz.below(4) + 1; fine && k > 0; --k) {
        auto [edit, accepts] = fuzz.edit(next);
        transaction.edits.push_back(std::move(edit));
        fine = accepts;
      }
      auto prepared = apply(*scene.now, transaction, scene.limits);
      CAPTURE(seed, step, dump::text(transaction), (prepared ? "" : prepared.error().message));
      REQUIRE(prepared.has_value() == fine);
      ++(fine ? accepted : refused);
      if (fine) {
        scene.now = prepared->snapshot;
        model = std::move(next);
      }
      check(*scene.now, model);
      if (step % 50 == 0) history.emplace_back(scene.now, dump::text(*scene.now));
    }
    for (const auto& [snapshot, text] : history) REQUIRE(dump::text(*snapshot) == text);
  }
  CHECK(accepted > 1000);
  CHECK(refused > 1000);
}
