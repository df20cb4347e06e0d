// A snapshot as the edits that rebuild it (restore.cpp). Called by ExportScene and the journal.
#include <fmt/format.h>

#include <algorithm>
#include <unordered_map>

#include "renderer/scene/motion.h"
#include "renderer/scene/scene.h"

namespace heliograph {
namespace {

/// Objects are created in the order of their indices, kind by kind, so that they get the same order
/// again. An entity whose ancestors come later gets its parent and its mesh or volume in a second
/// edit, when they are there: the default of its label depends on them.
class Description {
 public:
  Description(const Snapshot& snapshot, const TakeEdit& take) : scene_(snapshot), take_(take) {}

  SceneDescription make() {
    scene_.textures.for_each([&](u32 i, const Shared<Texture>& row) {
      add(Id::make(Kind::kTexture, scene_.textures.version(i), i), texture(*row.value));
    });
    scene_.materials.for_each([&](u32 i, const Shared<Material>& row) {
      add(Id::make(Kind::kMaterial, scene_.materials.version(i), i), material(*row.value));
    });
    scene_.meshes.for_each([&](u32 i, const Shared<Mesh>& row) {
      add(Id::make(Kind::kMesh, scene_.meshes.version(i), i),
          PutMesh{.topology = row.value->topology, .vertices = row.value->vertices});
    });
    scene_.volumes.for_each([&](u32 i, const Shared<Volume>& row) {
      add(Id::make(Kind::kVolume, scene_.volumes.version(i), i), describe(*row.value));
    });
    settings();
    entities();
    return {.scene = {}, .previous = previous(), .libraries = libraries()};
  }

 private:
  void add(Id id, Action action) {
    const std::string name = scene_.name_of(id);
    edit_of_[id] = made_;
    give({.target = name.empty() ? Ref() : Ref(name), .action = std::move(action)});
  }
  void give(Edit edit) {
    take_(std::move(edit));
    ++made_;
  }
  [[nodiscard]] Ref ref(Id id) const {
    return id ? Ref(CreatedByEdit{edit_of_.at(id)}) : Ref(Id{});
  }
  [[nodiscard]] TextureUsePatch use(TextureUse value) const {
    const Ref texture = ref(value.texture);
    value.texture = {};
    return {.texture = texture, .use = value};
  }

  [[nodiscard]] static PutTexture texture(const Texture& t) {
    return {.image = t.image,
            .srgb = t.srgb,
            .nearest = t.nearest,
            .wrap_u = t.wrap_u,
            .wrap_v = t.wrap_v};
  }

  /// Values that differ from the defaults.
  [[nodiscard]] PutMaterial material(const Material& m) const {
    const Material defaults = make_material();
    PutMaterial patch;
    for (std::size_t p = 0; p < kMaterialParameters; ++p) {
      if (m.parameters[p].value != defaults.parameters[p].value)
        patch.parameters[p].value = m.parameters[p].value;
      if (m.parameters[p].texture.texture)
        patch.parameters[p].texture = use(m.parameters[p].texture);
    }
#define HELIO_MAP(name) \
  if (m.name.texture) patch.name = use(m.name);
    HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
    if (m.alpha_mode != defaults.alpha_mode) patch.alpha_mode = m.alpha_mode;
    if (m.alpha_cutoff != defaults.alpha_cutoff) patch.alpha_cutoff = m.alpha_cutoff;
    if (m.two_sided_emission) patch.two_sided_emission = true;
    if (m.unlit) patch.unlit = true;
    if (m.thin_walled) patch.thin_walled = true;
    if (m.priority != 0) patch.priority = m.priority;
    return patch;
  }

  void settings() {
    PutSettings patch{.time = scene_.time};
    if (scene_.categories) patch.categories = *scene_.categories;
    if (const Dome* dome = scene_.dome.get())
      patch.dome = PutDome{.texture = ref(dome->texture),
                           .color = dome->color,
                           .intensity = dome->intensity,
                           .world_from_dome = dome->world_from_dome,
                           .camera_visible = dome->camera_visible,
                           .light_group = dome->light_group};
    give({.target = {}, .action = std::move(patch)});
  }

  // -------------------------------------------------------------- entities

  void entities() {
    std::vector<u32> later;
    std::vector<bool> complete(scene_.entities.capacity(), false);
    scene_.entities.for_each([&](u32 i, const Entity& e) {
      complete[i] = !e.parent || complete[e.parent.index()];
      PutEntity patch = entity(i, e);
      if (complete[i])
        bind_tree(e, patch);
      else
        later.push_back(i);
      add(scene_.entity_id(i), std::move(patch));
    });
    std::ranges::stable_sort(later, {}, [&](u32 i) { return depth(i); });
    for (const u32 i : later) {
      PutEntity patch;
      bind_tree(scene_.entities.at(i), patch);
      change(i, std::move(patch));
    }
    scene_.entities.for_each([&](u32 i, const Entity& e) {
      if (e.skin) change(i, PutEntity{.skin = skin(*e.skin)});
    });
  }
  void change(u32 index, PutEntity patch) {
    give({.mode = Mode::kUpdate,
          .target = ref(scene_.entity_id(index)),
          .action = std::move(patch)});
  }
  [[nodiscard]] u32 depth(u32 index) const {
    u32 above = 0;
    for (const Entity* e = scene_.find(scene_.entities.at(index).parent); e;
         e = scene_.find(e->parent))
      ++above;
    return above;
  }
  /// Sets what the default of a label depends on.
  void bind_tree(const Entity& e, PutEntity& patch) const {
    if (e.parent) patch.parent = ref(e.parent);
    if (e.mesh) patch.mesh = ref(e.mesh);
    if (e.volume) patch.volume = ref(e.volume);
  }

  /// Everything but parent, mesh, volume and skin.
  [[nodiscard]] PutEntity entity(u32 index, const Entity& e) const {
    PutEntity patch;
    patch.pose = pose(index, e);
    if (e.materials) {
      patch.materials.emplace();
      for (const MaterialId id : *e.materials) patch.materials->push_back(ref(id));
    }
    if (e.light) patch.light = light(*e.light);
    if (e.portal) patch.portal = *e.portal;
    if (e.camera) patch.camera = *e.camera;
    if (e.morph_weights) patch.morph_weights = *e.morph_weights;
    patch.label = label(e);
    patch.teleport = scene_.previous && !before_advance(scene_, index);
    if (!e.visible) patch.visible = false;
    if (e.visibility != kAllRays) patch.visibility = e.visibility;
    if (e.is_static) patch.is_static = true;
    if (e.shadow_catcher) patch.shadow_catcher = true;
    if (e.attributes) patch.attributes = *e.attributes;
    if (e.light_group) patch.light_group = *e.light_group;
    return patch;
  }
  [[nodiscard]] std::optional<PosePatch> pose(u32 index, const Entity& e) const {
    PosePatch patch;
    if (!e.keys) {
      if (scene_.poses[index] == mat4x3(1)) return std::nullopt;
      patch.matrices = {scene_.poses[index]};
      return patch;
    }
    for (const PoseKey& key : *e.keys) {
      patch.times.push_back(key.time);
      patch.matrices.push_back(key.matrix);
    }
    return patch;
  }
  [[nodiscard]] LightPatch light(const Light& value) const {
    LightPatch patch{.light = value, .texture = use(value.texture), .profile = ref(value.profile)};
    patch.light.texture = patch.texture.use;
    patch.light.profile = {};
    return patch;
  }
  [[nodiscard]] SkinPatch skin(const Skin& value) const {
    SkinPatch patch{.joints = {}, .inverse_binds = value.inverse_binds};
    for (const EntityId joint : value.joints) patch.joints.push_back(ref(joint));
    return patch;
  }
  /// An entity that lost its labelled ancestor since it got its mesh or volume opts out, which
  /// shows the same.
  [[nodiscard]] Boxed<LabelPatch> label(const Entity& e) const {
    const bool says = e.label.set || ((e.mesh || e.volume) && !labelled_above(e));
    if (!says && e.label.category == 0 && e.label.part == 0) return {};
    LabelPatch patch{.kind = says ? LabelPatch::Kind::kValue : LabelPatch::Kind::kInherit,
                     .value = e.label.value,
                     .group = e.label.group,
                     .part = e.label.part};
    if (e.label.category) patch.category = (*scene_.categories)[e.label.category - 1];
    return patch;
  }
  [[nodiscard]] bool labelled_above(const Entity& e) const {
    for (const Entity* above = scene_.find(e.parent); above; above = scene_.find(above->parent))
      if (above->label.set) return true;
    return false;
  }

  // -------------------------------------------------------------- before the last Advance

  [[nodiscard]] Transaction previous() const {
    if (!scene_.previous) return {};
    Transaction out;
    out.edits.push_back({.target = {}, .action = PutSettings{.time = scene_.previous->time}});
    const auto change = [&](Id id, Action action) {
      out.edits.push_back({.mode = Mode::kUpdate, .target = ref(id), .action = std::move(action)});
    };
    scene_.meshes.for_each([&](u32 i, const Shared<Mesh>& row) {
      const MeshId id = MeshId::make(scene_.meshes.version(i), i);
      const auto* then = scene_.previous->find(id);
      if (then && then->value->topology == row.value->topology &&
          then->value->vertices != row.value->vertices)
        change(id, PutMesh{.topology = nullptr, .vertices = then->value->vertices});
    });
    scene_.entities.for_each([&](u32 i, const Entity& e) {
      if (auto patch = previous(i, e)) change(scene_.entity_id(i), *std::move(patch));
    });
    return out;
  }
  /// State of an entity then that motion reads, where it differs. One that showed another surface
  /// shows none: its flow is invalid either way.
  [[nodiscard]] std::optional<PutEntity> previous(u32 index, const Entity& e) const {
    const Entity* then = before_advance(scene_, index);
    if (!then) return std::nullopt;
    PutEntity patch;
    const mat4x3 pose = local_pose(scene_, index, scene_.previous->time);
    const bool moved = !e.keys && pose != scene_.poses[index];
    const bool other = e.mesh && !mesh_before_advance(scene_, index);
    const bool morphed = !other && then->morph_weights != e.morph_weights;
    if (moved) patch.pose = PosePatch{.times = {}, .matrices = {pose}};
    if (other) patch.mesh = Id{};
    if (morphed && then->morph_weights) patch.morph_weights.emplace(*then->morph_weights);
    if (morphed && !then->morph_weights) patch.morph_weights.emplace(std::nullopt);
    if (!moved && !other && !morphed) return std::nullopt;
    return patch;
  }

  [[nodiscard]] std::vector<SceneDescription::KeptLibrary> libraries() const {
    std::vector<SceneDescription::KeptLibrary> out;
    scene_.libraries.for_each(
        [&](const std::string& asset, const std::shared_ptr<const Library>& library) {
          auto& kept = out.emplace_back();
          kept.asset = asset;
          for (const Id id : *library)
            kept.edits.push_back(scene_.alive(id) ? std::optional(edit_of_.at(id)) : std::nullopt);
        });
    std::ranges::sort(out, {}, &SceneDescription::KeptLibrary::asset);
    return out;
  }

  const Snapshot& scene_;
  const TakeEdit& take_;
  u32 made_ = 0;  // edits
  std::unordered_map<Id, u32> edit_of_;
};

}  // namespace

SceneDescription describe(const Snapshot& snapshot, const TakeEdit& take) {
  return Description(snapshot, take).make();
}

SceneDescription describe(const Snapshot& snapshot) {
  Transaction scene;
  SceneDescription all =
      describe(snapshot, [&](Edit edit) { scene.edits.push_back(std::move(edit)); });
  all.scene = std::move(scene);
  return all;
}

}  // namespace heliograph
