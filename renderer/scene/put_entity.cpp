// Putting entities: every field of a PutEntity, and the checks between fields. Called by apply().
#include <fmt/format.h>

#include <algorithm>

#include "renderer/scene/draft.h"
#include "renderer/scene/light_shapes.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

Status set_parent(const Snapshot& scene, EntityId self, EntityId parent, Entity& entity) {
  // An entity without children can only be its own ancestor directly.
  for (EntityId above = parent; above;) {
    if (above == self)
      return fail(Code::kInvalidArgument, "parent",
                  fmt::format("{} would be its own ancestor", describe_object(scene, self)));
    above = entity.children > 0 ? scene.find(above)->parent : EntityId();
  }
  entity.parent = parent;
  return {};
}

Status set_materials(const Scope& scope, const std::vector<Ref>& refs, Entity& entity) {
  std::vector<MaterialId> materials(refs.size());
  for (std::size_t k = 0; k < refs.size(); ++k)
    if (!scope.bind(refs[k], "materials.parts", materials[k]))
      return scope.bind(refs[k], fmt::format("materials.parts[{}]", k), materials[k]);
  if (entity.materials && *entity.materials == materials) return {};
  entity.materials = materials.empty()
                         ? nullptr
                         : std::make_shared<const std::vector<MaterialId>>(std::move(materials));
  return {};
}

Status set_light(const Scope& scope, const std::optional<LightPatch>& patch, Entity& entity) {
  if (!patch) {
    entity.light = nullptr;
    return {};
  }
  Light light = patch->light;
  HELIO_TRY(bind(scope, patch->texture, "light.texture", light.texture));
  HELIO_TRY(scope.bind(patch->profile, "light.profile", light.profile));
  entity.light = std::make_shared<const Light>(light);
  return {};
}

Status set_skin(const Scope& scope, const std::optional<SkinPatch>& patch, Entity& entity) {
  if (!patch) {
    entity.skin = nullptr;
    return {};
  }
  Skin skin{.joints = std::vector<EntityId>(patch->joints.size()),
            .inverse_binds = patch->inverse_binds};
  if (skin.joints.empty())
    return fail(Code::kInvalidArgument, "skin.joints", "a skin has at least one joint");
  if (skin.inverse_binds.size() != skin.joints.size())
    return fail(Code::kInvalidArgument, "skin.inverse_binds",
                fmt::format("{} matrices for {} joints; give one each", skin.inverse_binds.size(),
                            skin.joints.size()));
  for (std::size_t k = 0; k < skin.joints.size(); ++k) {
    const std::string field = fmt::format("skin.joints[{}]", k);
    HELIO_TRY(scope.bind(patch->joints[k], field, skin.joints[k]));
    if (!skin.joints[k])
      return fail(Code::kInvalidArgument, field, "a joint is an entity; this names nothing");
  }
  entity.skin = std::make_shared<const Skin>(std::move(skin));
  return {};
}

Status set_morph_weights(const std::optional<MorphWeights>& patch, Entity& entity) {
  entity.morph_weights = nullptr;
  if (!patch) return {};
  const std::size_t keys = std::max<std::size_t>(1, patch->times.size());
  if (patch->weights.empty() || patch->weights.size() % keys != 0)
    return fail(
        Code::kInvalidArgument, "morph_weights.weights",
        fmt::format("{} weights do not make rows at {} times", patch->weights.size(), keys));
  entity.morph_weights = std::make_shared<const MorphWeights>(*patch);
  return {};
}

/// Keys, or a constant pose.
Status read_pose(const PosePatch& patch, Entity& entity, mat4x3& pose) {
  const std::size_t keys = std::max<std::size_t>(1, patch.times.size());
  if (patch.matrices.size() != keys)
    return fail(Code::kInvalidArgument, "pose.matrices",
                fmt::format("{} matrices at {} times", patch.matrices.size(), keys));
  if (std::ranges::adjacent_find(patch.times, std::greater_equal()) != patch.times.end())
    return fail(Code::kInvalidArgument, "pose.times", "times have to increase strictly");
  entity.keys = nullptr;
  pose = patch.matrices[0];
  if (keys == 1) return {};
  auto path = std::make_shared<PoseKeys>(keys);
  for (std::size_t k = 0; k < keys; ++k)
    (*path)[k] = {.time = patch.times[k], .matrix = patch.matrices[k]};
  entity.keys = std::move(path);
  return {};
}

Status set_references(const Scope& scope, const PutEntity& patch, Entity& entity) {
  if (patch.mesh) HELIO_TRY(scope.bind(*patch.mesh, "mesh", entity.mesh));
  if (patch.volume) HELIO_TRY(scope.bind(*patch.volume, "volume", entity.volume));
  if (patch.materials) HELIO_TRY(set_materials(scope, *patch.materials, entity));
  if (patch.light) HELIO_TRY(set_light(scope, *patch.light, entity));
  if (patch.skin) HELIO_TRY(set_skin(scope, *patch.skin, entity));
  return {};
}

void set_light_group(const std::string& name, Entity& entity) {
  const std::string now = entity.light_group ? *entity.light_group : "";
  if (name == now) return;
  entity.light_group = name.empty() ? nullptr : std::make_shared<const std::string>(name);
}

void set_values(const PutEntity& patch, Entity& entity) {
  if (patch.portal)
    entity.portal = *patch.portal ? std::make_shared<const Portal>(**patch.portal) : nullptr;
  if (patch.camera)
    entity.camera = *patch.camera ? std::make_shared<const Camera>(**patch.camera) : nullptr;
  if (patch.visible) entity.visible = *patch.visible;
  if (patch.visibility) entity.visibility = *patch.visibility;
  if (patch.is_static) entity.is_static = *patch.is_static;
  if (patch.shadow_catcher) entity.shadow_catcher = *patch.shadow_catcher;
  if (patch.attributes)
    entity.attributes =
        patch.attributes->empty() ? nullptr : std::make_shared<const Attributes>(*patch.attributes);
  if (patch.light_group) set_light_group(*patch.light_group, entity);
}

Status check(const Snapshot& scene, const PutEntity& patch, const Entity& entity) {
  if (entity.mesh && entity.volume)
    return fail(Code::kInvalidArgument, patch.volume ? "volume" : "mesh",
                "an entity has a mesh or a volume, not both; use two entities");
  if (has_light_shape(entity) && entity.volume)
    return fail(Code::kInvalidArgument, patch.volume ? "volume" : "light.shape",
                "an entity has a light's shape or a volume, not both; use two entities");
  if (has_light_shape(entity) && entity.mesh)
    return fail(Code::kInvalidArgument, patch.mesh ? "mesh" : "light.shape",
                "an entity has a mesh or a light's shape, not both; use two entities");
  if (has_light_shape(entity) && entity.materials)
    return fail(Code::kInvalidArgument, patch.materials ? "materials" : "light.shape",
                "a light's shape has no materials; use a mesh that emits, or clear them");
  if (!entity.mesh) return {};
  const MeshTopology& topology = *scene.find(entity.mesh)->value->topology;
  if (patch.mesh || patch.light) HELIO_TRY(check_light(entity, topology));
  if (!(patch.mesh || patch.skin || patch.morph_weights)) return {};
  return check_deformation(entity, topology);
}

void label(Draft& draft, const PutEntity& patch, Entity& entity) {
  if (patch.label) set_label(draft, entity, *patch.label);
  const bool asks = (entity.mesh || entity.volume) && (patch.mesh || patch.volume || patch.label);
  if (asks && !entity.label.set && !labelled_above(draft.next, entity.parent))
    set_auto_label(draft, entity);
}

Status change(Draft& draft, const Scope& scope, EntityId id, const PutEntity& patch) {
  Entity entity = *draft.next.find(id);
  mat4x3 pose = draft.next.poses[id.index()];
  if (patch.parent) {
    EntityId parent;
    HELIO_TRY(scope.bind(*patch.parent, "parent", parent));
    HELIO_TRY(set_parent(draft.next, id, parent, entity));
  }
  HELIO_TRY(set_references(scope, patch, entity));
  if (patch.pose) HELIO_TRY(read_pose(*patch.pose, entity, pose));
  if (patch.morph_weights) HELIO_TRY(set_morph_weights(*patch.morph_weights, entity));
  set_values(patch, entity);
  if (patch.teleport) entity.teleported = draft.next.advances;
  HELIO_TRY(check(draft.next, patch, entity));
  label(draft, patch, entity);
  store(draft, id, entity);
  set_pose(draft, id, entity.keys ? local_pose(draft.next, id.index(), draft.next.time) : pose);
  return {};
}

}  // namespace

Status bind(const Scope& scope, const TextureUsePatch& patch, std::string_view field,
            TextureUse& out) {
  out = patch.use;
  if (auto status = scope.bind(patch.texture, "texture", out.texture); !status)
    return std::unexpected(std::move(status).error().at(std::string(field)));
  return {};
}

Status check_light(const Entity& entity, const MeshTopology& topology) {
  const Light* light = entity.light.get();
  if (topology.curves.empty() || !light || light->sun_angle > 0) return {};
  return fail(Code::kInvalidArgument, "light",
              "curves give off no light of an entity; give their material emission, or use a mesh "
              "of triangles");
}

Status check_deformation(const Entity& entity, const MeshTopology& topology) {
  if (entity.morph_weights) {
    const std::size_t keys = std::max<std::size_t>(1, entity.morph_weights->times.size());
    const std::size_t weights = entity.morph_weights->weights.size() / keys;
    if (weights != topology.morph_count)
      return fail(
          Code::kInvalidArgument, "morph_weights.weights",
          fmt::format("{} weights for the mesh's {} morph targets", weights, topology.morph_count));
  }
  if (!entity.skin) return {};
  if (topology.joints.empty() || topology.weights.empty())
    return fail(Code::kInvalidArgument, "skin",
                "the mesh has no joints and weights that a skin could move");
  const std::size_t joints = entity.skin->joints.size();
  for (std::size_t v = 0; v < topology.joints.size(); ++v)
    for (int k = 0; k < 4; ++k)
      if (topology.joints[v][k] >= joints)
        return fail(Code::kInvalidArgument, "skin.joints",
                    fmt::format("vertex {} of the mesh follows joint {}, the skin has {}", v,
                                topology.joints[v][k], joints));
  return {};
}

Expected<EntityId> create_entity(Draft& draft, const std::string& name, const Entity& row) {
  Snapshot& scene = draft.next;
  if (scene.entities.count() >= draft.limits.entities)
    return std::unexpected(
        Error{.code = Code::kResourceExhausted,
              .message = fmt::format("the scene may have {} entities", draft.limits.entities),
              .where = {},
              .limit = "entities",
              .needed = u64(scene.entities.count()) + 1,
              .available = draft.limits.entities});
  const u32 index = scene.entities.insert({});
  if (index == scene.poses.size()) scene.poses.push_back(mat4x3(1));
  const EntityId id = scene.entity_id(index);
  Entity& entity = scene.entities.write(index);
  if (!name.empty()) {
    entity.name = std::make_shared<const std::string>(name);
    scene.names.set(name, id);
  }
  Entity complete = row;
  complete.name = entity.name;
  store(draft, id, complete);
  return id;
}

void store(Draft& draft, EntityId id, const Entity& row) {
  const Entity before = *draft.next.find(id);
  if (before == row) return;
  draft.next.entities.write(id.index()) = row;
  count(draft, before, row);
}

void set_pose(Draft& draft, EntityId id, const mat4x3& pose) {
  if (draft.next.poses[id.index()] != pose) draft.next.poses.write(id.index()) = pose;
}

Expected<Id> put(Draft& draft, const Scope& scope, const Target& target, const PutEntity& patch) {
  EntityId id(target.id);
  if (!id) {
    auto created = create_entity(draft, target.name, {});
    if (!created) return std::unexpected(std::move(created).error());
    id = *created;
  }
  HELIO_TRY(change(draft, scope, id, patch));
  return id;
}

}  // namespace heliograph
