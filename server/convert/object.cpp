// Rows to patches.
#include "server/convert/object.h"

#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

Ref ref(Id id) { return id ? Ref(id) : Ref(); }

TextureUsePatch use_of(const TextureUse& use) {
  TextureUsePatch patch{.texture = ref(use.texture), .use = use};
  patch.use.texture = {};
  return patch;
}

PosePatch pose_of(const Snapshot& snapshot, u32 index, const Entity& entity) {
  PosePatch pose;
  if (!entity.keys) {
    pose.matrices = {snapshot.poses[index]};
    return pose;
  }
  for (const PoseKey& key : *entity.keys) {
    pose.times.push_back(key.time);
    pose.matrices.push_back(key.matrix);
  }
  return pose;
}

LabelPatch label_of(const Snapshot& snapshot, const Label& label) {
  using Kind = LabelPatch::Kind;
  LabelPatch patch{.kind = label.set ? Kind::kValue : Kind::kInherit,
                   .value = label.value,
                   .group = label.group,
                   .part = label.part};
  if (label.category > 0) patch.category = (*snapshot.categories)[label.category - 1];
  return patch;
}

PutEntity entity_of(const Snapshot& snapshot, u32 index, const Entity& entity) {
  PutEntity patch{.parent = ref(entity.parent),
                  .pose = pose_of(snapshot, index, entity),
                  .mesh = ref(entity.mesh),
                  .volume = ref(entity.volume),
                  .label = label_of(snapshot, entity.label),
                  .visible = entity.visible,
                  .visibility = entity.visibility,
                  .is_static = entity.is_static,
                  .shadow_catcher = entity.shadow_catcher};
  patch.materials.emplace();
  if (entity.materials)
    for (const MaterialId id : *entity.materials) patch.materials->push_back(ref(id));
  if (entity.light) {
    const Light& light = *entity.light;
    patch.light = LightPatch{light, use_of(light.texture), ref(light.profile)};
    (*patch.light)->light.texture = {};
    (*patch.light)->light.profile = {};
  }
  if (entity.portal) patch.portal = *entity.portal;
  if (entity.camera) patch.camera = *entity.camera;
  if (entity.skin) {
    SkinPatch skin{.inverse_binds = entity.skin->inverse_binds};
    for (const EntityId joint : entity.skin->joints) skin.joints.push_back(ref(joint));
    patch.skin = std::move(skin);
  }
  if (entity.morph_weights) patch.morph_weights = *entity.morph_weights;
  if (entity.attributes) patch.attributes = *entity.attributes;
  if (entity.light_group) patch.light_group = *entity.light_group;
  return patch;
}

PutMaterial material_of(const Material& material) {
  PutMaterial patch{.alpha_mode = material.alpha_mode,
                    .alpha_cutoff = material.alpha_cutoff,
                    .two_sided_emission = material.two_sided_emission,
                    .unlit = material.unlit,
                    .thin_walled = material.thin_walled,
                    .priority = material.priority};
  for (std::size_t i = 0; i < kMaterialParameters; ++i) {
    patch.parameters[i].value = material.parameters[i].value;
    if (material.parameters[i].texture.texture)
      patch.parameters[i].texture = use_of(material.parameters[i].texture);
  }
#define HELIO_MAP(name) \
  if (material.name.texture) patch.name = use_of(material.name);
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  return patch;
}

PutTexture texture_of(const Texture& texture) {
  return {.image = texture.image,
          .srgb = texture.srgb,
          .nearest = texture.nearest,
          .wrap_u = texture.wrap_u,
          .wrap_v = texture.wrap_v};
}

}  // namespace

v1::Material default_material() { return to_proto(material_of(make_material()), {}); }

Action describe_object(const Snapshot& snapshot, Id id) {
  if (const Entity* entity = snapshot.find(EntityId(id)))
    return entity_of(snapshot, id.index(), *entity);
  if (const auto* mesh = snapshot.find(MeshId(id)))
    return PutMesh{mesh->value->topology, mesh->value->vertices};
  if (const auto* material = snapshot.find(MaterialId(id))) return material_of(*material->value);
  if (const auto* texture = snapshot.find(TextureId(id))) return texture_of(*texture->value);
  return describe(*snapshot.find(VolumeId(id))->value);
}

PutDome describe_dome(const Snapshot& snapshot) {
  const Dome dome = snapshot.dome ? *snapshot.dome : Dome{};
  return {.texture = ref(dome.texture),
          .color = dome.color,
          .intensity = dome.intensity,
          .world_from_dome = dome.world_from_dome,
          .camera_visible = dome.camera_visible,
          .light_group = dome.light_group};
}

}  // namespace heliograph::server
