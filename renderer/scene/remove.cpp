// Removing objects, with their users when asked to, and pruning what nobody uses. Called by
// apply().
#include <fmt/format.h>

#include <algorithm>

#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

constexpr std::size_t kUsersNamed = 16;

// ---------------------------------------------------------------- who uses what

bool uses(const TextureUse& use, Id id) { return use.texture == id; }

bool uses(const Light& light, Id id) { return uses(light.texture, id) || light.profile == id; }

bool uses(const Material& material, Id id) {
#define HELIO_MAP(name) \
  if (uses(material.name, id)) return true;
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  return std::ranges::any_of(material.parameters,
                             [&](const Parameter& p) { return uses(p.texture, id); });
}

bool uses(const Entity& entity, Id id) {
  return entity.parent == id || entity.mesh == id || entity.volume == id ||
         (entity.light && uses(*entity.light, id)) ||
         (entity.materials &&
          std::ranges::find(*entity.materials, id) != entity.materials->end()) ||
         (entity.skin && std::ranges::find(entity.skin->joints, id) != entity.skin->joints.end());
}

std::unexpected<Error> refuse(const Snapshot& scene, Id id) {
  std::vector<std::string> users;
  scene.entities.for_each([&](u32 index, const Entity& entity) {
    const EntityId user = scene.entity_id(index);
    if (user != id && uses(entity, id)) users.push_back(describe_object(scene, user));
  });
  scene.materials.for_each([&](u32 index, const Shared<Material>& row) {
    if (uses(*row.value, id))
      users.push_back(
          describe_object(scene, Id::make(Kind::kMaterial, scene.materials.version(index), index)));
  });
  if (scene.dome && scene.dome->texture == id) users.push_back("the dome");
  std::string message = fmt::format(
      "{} is in use by {} objects, {} among them; remove them first, "
      "or set cascade",
      describe_object(scene, id), users.size(), users.front());
  users.resize(std::min(users.size(), kUsersNamed));
  return std::unexpected(Error{.code = Code::kFailedPrecondition,
                               .message = std::move(message),
                               .where = {},
                               .users = std::move(users)});
}

// ---------------------------------------------------------------- unbinding

void unbind(TextureUse& use, Id id) {
  if (uses(use, id)) use = {};
}

Material without(Material material, Id id) {
#define HELIO_MAP(name) unbind(material.name, id);
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  for (Parameter& p : material.parameters) unbind(p.texture, id);
  return material;
}

/// The entity without this mesh, volume, material, texture, or without the skin of this joint.
Entity without(Entity entity, Id id) {
  if (entity.mesh == id) entity.mesh = {};
  if (entity.volume == id) entity.volume = {};
  if (entity.materials && std::ranges::find(*entity.materials, id) != entity.materials->end()) {
    std::vector<MaterialId> left = *entity.materials;
    std::ranges::replace(left, MaterialId(id), MaterialId());
    entity.materials = std::make_shared<const std::vector<MaterialId>>(std::move(left));
  }
  if (entity.light && uses(*entity.light, id)) {
    Light light = *entity.light;
    unbind(light.texture, id);
    if (light.profile == id) light.profile = {};
    entity.light = std::make_shared<const Light>(light);
  }
  if (entity.skin && std::ranges::find(entity.skin->joints, id) != entity.skin->joints.end())
    entity.skin = nullptr;
  return entity;
}

void unbind_everywhere(Draft& draft, Id id) {
  Snapshot& scene = draft.next;
  for (u32 i = 0; i < scene.entities.capacity(); ++i)
    if (scene.entities.alive(i) && uses(scene.entities.at(i), id))
      store(draft, scene.entity_id(i), without(scene.entities.at(i), id));
  for (u32 i = 0; i < scene.materials.capacity(); ++i) {
    if (!scene.materials.alive(i) || !uses(*scene.materials.at(i).value, id)) continue;
    const auto before = scene.materials.at(i).value;
    const Material after = without(*before, id);
    scene.materials.write(i).value = std::make_shared<const Material>(after);
    count(draft, *before, after);
  }
  if (scene.dome && scene.dome->texture == id) {
    Dome dome = *scene.dome;
    dome.texture = {};
    count(draft, *scene.dome, dome);
    scene.dome = std::make_shared<const Dome>(dome);
  }
}

// ---------------------------------------------------------------- entities

/// The indices of an entity and everything beneath it, parents first.
std::vector<u32> subtree(const Snapshot& scene, EntityId root) {
  std::vector<u32> found{root.index()};
  if (scene.find(root)->children == 0) return found;
  std::vector<std::vector<u32>> children(scene.entities.capacity());
  scene.entities.for_each([&](u32 index, const Entity& entity) {
    if (entity.parent) children[entity.parent.index()].push_back(index);
  });
  for (std::size_t k = 0; k < found.size(); ++k)
    found.insert(found.end(), children[found[k]].begin(), children[found[k]].end());
  return found;
}

void erase_entity(Draft& draft, EntityId id) {
  store(draft, id, Entity{.name = draft.next.find(id)->name});
  set_pose(draft, id, mat4x3(1));
  if (const auto& name = draft.next.find(id)->name) draft.next.names.erase(*name, Kind::kEntity);
  draft.next.entities.erase(id.index());
}

Status remove_entity(Draft& draft, EntityId id, bool cascade) {
  const Entity& entity = *draft.next.find(id);
  const u32 own = entity.skin ? u32(std::ranges::count(entity.skin->joints, id)) : 0;
  if (!cascade && (entity.children > 0 || entity.skins > own)) return refuse(draft.next, id);
  const std::vector<u32> all = subtree(draft.next, id);
  for (const u32 index : all) {
    Entity bare = draft.next.entities.at(index);
    bare.skin = nullptr;
    store(draft, draft.next.entity_id(index), bare);
  }
  for (const u32 index : all)
    if (draft.next.entities.at(index).skins > 0)
      unbind_everywhere(draft, draft.next.entity_id(index));
  for (auto index = all.rbegin(); index != all.rend(); ++index)
    erase_entity(draft, draft.next.entity_id(*index));
  return {};
}

// ---------------------------------------------------------------- shared objects

template <class T>
void erase_shared(Draft& draft, Table<Shared<T>>& table, u32 index) {
  const Shared<T> row = table.at(index);
  if constexpr (std::is_same_v<T, Material>) count(draft, *row.value, Material{});
  draft.next.array_bound -= bytes_of(*row.value);
  if (row.name) draft.next.names.erase(*row.name, kKindOf<T>);
  table.erase(index);
}

template <class T>
Status remove_shared(Draft& draft, Table<Shared<T>>& table, Id id, bool cascade) {
  if (table.at(id.index()).uses > 0) {
    if (!cascade) return refuse(draft.next, id);
    unbind_everywhere(draft, id);
  }
  erase_shared(draft, table, id.index());
  return {};
}

template <class T>
void prune(Draft& draft, Table<Shared<T>>& table) {
  for (u32 i = 0; i < table.capacity(); ++i)
    if (table.alive(i) && table.at(i).uses == 0) erase_shared(draft, table, i);
}

}  // namespace

Status remove(Draft& draft, Id id, bool cascade) {
  switch (id.kind()) {
    case Kind::kEntity:
      return remove_entity(draft, EntityId(id), cascade);
    case Kind::kMesh:
      return remove_shared(draft, draft.next.meshes, id, cascade);
    case Kind::kMaterial:
      return remove_shared(draft, draft.next.materials, id, cascade);
    case Kind::kTexture:
      return remove_shared(draft, draft.next.textures, id, cascade);
    case Kind::kVolume:
      return remove_shared(draft, draft.next.volumes, id, cascade);
    case Kind::kNone:
      break;
  }
  return fail(Code::kInvalidArgument, "target", "a removal names what it removes");
}

void prune(Draft& draft) {
  prune(draft, draft.next.meshes);
  prune(draft, draft.next.volumes);
  prune(draft, draft.next.materials);  // before the textures that only they used
  prune(draft, draft.next.textures);
}

}  // namespace heliograph
