// A snapshot as the transaction that rebuilds it. Called by ExportScene and Read.
#include <algorithm>
#include <unordered_map>

#include "renderer/scene/scene.h"

namespace heliograph {
namespace {

/// Owns: the edits so far. Objects are created in the order of their indices, kind by kind, so
/// that they get the same order again. An entity whose ancestors come later gets its parent and its
/// mesh in a second edit, when they are there: the default of its label depends on them.
class Description {
 public:
  explicit Description(const Snapshot& snapshot) : scene_(snapshot) {}

  Transaction make() {
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
      add(Id::make(Kind::kVolume, scene_.volumes.version(i), i), PutVolume{.volume = row.value});
    });
    settings();
    entities();
    return std::move(transaction_);
  }

 private:
  void add(Id id, Action action) {
    const std::string name = scene_.name_of(id);
    edit_of_[id] = u32(transaction_.edits.size());
    transaction_.edits.push_back(
        {.target = name.empty() ? Ref() : Ref(name), .action = std::move(action)});
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

  /// What differs from the defaults.
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
                           .camera_visible = dome->camera_visible};
    transaction_.edits.push_back({.target = {}, .action = std::move(patch)});
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
    transaction_.edits.push_back({.mode = Mode::kUpdate,
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
  /// What the default of a label depends on.
  void bind_tree(const Entity& e, PutEntity& patch) const {
    if (e.parent) patch.parent = ref(e.parent);
    if (e.mesh) patch.mesh = ref(e.mesh);
  }

  /// Everything but parent, mesh and skin.
  [[nodiscard]] PutEntity entity(u32 index, const Entity& e) const {
    PutEntity patch;
    patch.pose = pose(index, e);
    if (e.volume) patch.volume = ref(e.volume);
    if (e.materials) {
      patch.materials.emplace();
      for (const MaterialId id : *e.materials) patch.materials->push_back(ref(id));
    }
    if (e.light) patch.light = light(*e.light);
    if (e.camera) patch.camera = *e.camera;
    if (e.morph_weights) patch.morph_weights = *e.morph_weights;
    patch.label = label(e);
    if (!e.visible) patch.visible = false;
    if (e.visibility != kAllRays) patch.visibility = e.visibility;
    if (e.is_static) patch.is_static = true;
    if (e.attributes) patch.attributes = *e.attributes;
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
    LightPatch patch{.light = value, .texture = use(value.texture)};
    patch.light.texture = patch.texture.use;
    return patch;
  }
  [[nodiscard]] SkinPatch skin(const Skin& value) const {
    SkinPatch patch{.joints = {}, .inverse_binds = value.inverse_binds};
    for (const EntityId joint : value.joints) patch.joints.push_back(ref(joint));
    return patch;
  }
  /// An entity that lost its labelled ancestor since it got its mesh opts out, which shows the
  /// same.
  [[nodiscard]] std::optional<LabelPatch> label(const Entity& e) const {
    const bool says = e.label.set || (e.mesh && !labelled_above(e));
    if (!says && e.label.category == 0 && e.label.part == 0) return std::nullopt;
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

  const Snapshot& scene_;
  Transaction transaction_;
  std::unordered_map<Id, u32> edit_of_;
};

}  // namespace

Transaction describe(const Snapshot& snapshot) { return Description(snapshot).make(); }

}  // namespace heliograph
