// Entities to slots.
#include "renderer/placement/structure.h"

#include <algorithm>
#include <numeric>
#include <unordered_map>
#include <utility>

#include "renderer/base/parallel.h"
#include "renderer/scene/light_shapes.h"

namespace heliograph::resident {
namespace {

/// Visibility of each entity with all its ancestors, by index. Parents may have any index.
std::vector<u8> visibility_of_all(const Snapshot& snapshot) {
  enum : u8 { kUnknown, kHidden, kShown };
  std::vector<u8> state(snapshot.entities.capacity(), kUnknown);
  std::vector<u32> chain;
  snapshot.entities.for_each([&](u32 index, const Entity&) {
    u8 result = kShown;
    for (u32 i = index;;) {
      if (state[i] != kUnknown) {
        result = state[i];
        break;
      }
      chain.push_back(i);
      const Entity& entity = snapshot.entities.at(i);
      if (!entity.visible) result = kHidden;
      if (result == kHidden || !entity.parent) break;
      i = entity.parent.index();
    }
    // An ancestor that is hidden hides all below it, and the last of the chain is the topmost.
    for (; !chain.empty(); chain.pop_back()) state[chain.back()] = result;
  });
  for (u8& s : state) s = s == kShown;
  return state;
}

bool is_sun(const Entity& entity) { return entity.light && entity.light->sun_angle > 0; }

/// The entities that are shown, among those that `chosen` takes.
template <class F>
std::vector<u32> shown_among(const Snapshot& snapshot, F&& chosen) {
  std::vector<u32> entities;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (chosen(entity)) entities.push_back(index);
  });
  if (entities.empty()) return entities;
  const std::vector<u8> shown = visibility_of_all(snapshot);
  std::erase_if(entities, [&](u32 index) { return !shown[index]; });
  return entities;
}

template <class F>
void for_each_shown(const Snapshot& snapshot, F&& f) {
  const std::vector<u8> shown = visibility_of_all(snapshot);
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (!shown[index]) return;
    const Mesh* mesh = shown_mesh(snapshot, entity);
    if (mesh && !mesh->topology->triangles.empty()) f(index, entity, *mesh);
  });
}

bool deforms(const Entity& entity, const Mesh& mesh) {
  if (has_light_shape(entity)) return false;
  return mesh.vertices->times.size() > 1 || entity.skin || mesh.topology->morph_count > 0;
}

void add_materials(const Snapshot& snapshot, const Entity& entity, u32 parts,
                   std::vector<u32>& out) {
  const u32 fallback = snapshot.materials.capacity() + (has_light_shape(entity) ? 1 : 0);
  for (u32 part = 0; part < parts; ++part) {
    if (!entity.materials || entity.materials->empty()) {
      out.push_back(fallback);
      continue;
    }
    const auto& ids = *entity.materials;
    const MaterialId id = ids[std::min<std::size_t>(part, ids.size() - 1)];
    out.push_back(snapshot.find(id) ? id.index() : fallback);
  }
}

/// Numbers the meshes that entities may show: rows of the scene's table, then light shapes.
u32 mesh_number(const Snapshot& snapshot, const Entity& entity) {
  if (!has_light_shape(entity)) return entity.mesh.index();
  return snapshot.meshes.capacity() + u32(entity.light->shape) - 1;
}

struct ShownMesh {
  const Mesh* mesh;
  u32 number;
};

/// The meshes that visible entities show, each once, in order of first use.
std::vector<ShownMesh> shown_meshes(const Snapshot& snapshot) {
  std::vector<ShownMesh> order;
  std::vector<bool> seen(snapshot.meshes.capacity() + kLightShapes);
  for_each_shown(snapshot, [&](u32, const Entity& entity, const Mesh& mesh) {
    const u32 number = mesh_number(snapshot, entity);
    if (seen[number]) return;
    seen[number] = true;
    order.push_back({&mesh, number});
  });
  return order;
}

/// Takes over from the other one what has a part in no structure before they are compared.
bool same_structure(const Entity& a, const Entity& b) {
  Entity like = a;
  const auto take = [](auto& field, const auto& other) {
    if (bool(field) == bool(other)) field = other;
  };
  const bool same_light =
      (!a.light && !b.light) || (a.light && b.light && a.light->shape == b.light->shape &&
                                 is_sun(a) == is_sun(b) && shown_scale(a) == shown_scale(b));
  if (same_light) like.light = b.light;
  take(like.keys, b.keys);
  take(like.portal, b.portal);
  like.name = b.name;
  like.camera = b.camera;
  like.morph_weights = b.morph_weights;
  like.attributes = b.attributes;
  like.children = b.children;
  like.skins = b.skins;
  like.teleported = b.teleported;
  like.visibility = b.visibility;
  like.shadow_catcher = b.shadow_catcher;
  return like == b;
}

bool same_structure(const Table<Entity>& a, const Table<Entity>& b) {
  if (a.capacity() != b.capacity()) return false;
  for (u32 c = 0; c < a.chunk_count(); ++c) {
    if (a.shares(c, b)) continue;
    const u32 begin = c * ChunkedArray<Entity>::kRows;
    const u32 end = std::min(begin + ChunkedArray<Entity>::kRows, a.capacity());
    for (u32 i = begin; i < end; ++i) {
      if (a.alive(i) != b.alive(i) || a.version(i) != b.version(i)) return false;
      if (a.alive(i) && !same_structure(a.at(i), b.at(i))) return false;
    }
  }
  return true;
}

Children children_of(const Snapshot& snapshot) {
  Children children;
  const auto for_each_child = [&](auto&& f) {
    snapshot.entities.for_each([&](u32 index, const Entity& entity) {
      if (entity.parent) f(entity.parent.index(), index);
    });
  };
  u32 count = 0;
  for_each_child([&](u32, u32) { ++count; });
  if (count == 0) return children;
  children.first.assign(snapshot.entities.capacity() + 1, 0);
  children.of.resize(count);
  for_each_child([&](u32 parent, u32) { ++children.first[parent + 1]; });
  std::partial_sum(children.first.begin(), children.first.end(), children.first.begin());
  std::vector<u32> next(children.first.begin(), children.first.end() - 1);
  for_each_child([&](u32 parent, u32 child) { children.of[next[parent]++] = child; });
  return children;
}

void set_labels(const Snapshot& snapshot, Structure& structure, std::vector<u32>& row_of_entity) {
  structure.labelling = label_entities(snapshot);
  row_of_entity.assign(snapshot.entities.capacity(), kNone);
  structure.row_of_root.assign(snapshot.entities.capacity(), kNone);
  for (u32 row = 0; row < structure.labelling.instances.size(); ++row) {
    const Instance& instance = structure.labelling.instances[row];
    structure.row_of_root[instance.root] = row;
    for (const u32 entity : instance.entities) row_of_entity[entity] = row;
  }
}

/// Numbers in the order of slots, then of volumes.
void set_groups(const Snapshot& snapshot, Structure& structure) {
  structure.groups = {""};
  std::unordered_map<std::string, u32> known;
  const auto group_of = [&](u32 entity) {
    const std::string* name = snapshot.entities.at(entity).light_group.get();
    if (!name || name->empty()) return 0u;
    const auto [entry, is_new] = known.try_emplace(*name, u32(structure.groups.size()));
    if (is_new) structure.groups.push_back(*name);
    return entry->second;
  };
  for (const Slot& slot : structure.slots) structure.group_of_slot.push_back(group_of(slot.entity));
  for (const VolumeSlot& volume : structure.volumes)
    structure.group_of_volume.push_back(group_of(volume.entity));
}

/// Lists of some of the slots and entities.
void set_lists(const Snapshot& snapshot, Structure& structure) {
  structure.children = children_of(snapshot);
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (entity.keys) structure.keyed.push_back(index);
  });
  for (u32 i = 0; i < structure.slots.size(); ++i) {
    const Slot& slot = structure.slots[i];
    if (slot.deforms)
      structure.deforming.push_back(i);
    else if (snapshot.entities.at(slot.entity).is_static)
      structure.fixed.push_back(i);
  }
  set_groups(snapshot, structure);
}

}  // namespace

bool same_structure(const Snapshot& a, const Snapshot& b) {
  return a.meshes.same(b.meshes) && a.volumes.same(b.volumes) &&
         a.materials.capacity() == b.materials.capacity() && a.categories == b.categories &&
         same_structure(a.entities, b.entities);
}

std::vector<u32> with_descendants(const Structure& structure, std::vector<u32> entities) {
  const auto& [first, of] = structure.children;
  if (of.empty()) return entities;
  std::vector<u8> known(structure.slot_of_entity.size());
  for (const u32 entity : entities) known[entity] = 1;
  for (std::size_t i = 0; i < entities.size(); ++i)
    for (u32 k = first[entities[i]]; k < first[entities[i] + 1]; ++k)
      if (!std::exchange(known[of[k]], u8(1))) entities.push_back(of[k]);
  std::ranges::sort(entities);
  return entities;
}

Expected<std::shared_ptr<const Structure>> make_structure(const Snapshot& snapshot,
                                                          const MeshBuilder& builder) {
  auto structure = std::make_shared<Structure>();
  const std::vector<ShownMesh> shown = shown_meshes(snapshot);
  std::vector<Expected<std::shared_ptr<DeviceMesh>>> built(shown.size());
  parallel_for(shown.size(), [&](std::size_t i) { built[i] = builder.build(*shown[i].mesh); });
  std::vector<u32> position(snapshot.meshes.capacity() + kLightShapes, kNone);
  for (std::size_t i = 0; i < shown.size(); ++i) {
    if (!built[i])
      return std::unexpected(
          std::move(built[i]).error().at("meshes[" + std::to_string(shown[i].number) + "]"));
    position[shown[i].number] = u32(i);
    structure->meshes.push_back(*std::move(built[i]));
  }

  structure->suns = shown_among(snapshot, is_sun);
  structure->idle = shown_among(snapshot, [&](const Entity& entity) {
    return entity.light && !is_sun(entity) && !shown_mesh(snapshot, entity);
  });
  structure->portals =
      shown_among(snapshot, [](const Entity& entity) { return bool(entity.portal); });
  std::vector<u32> row_of_entity;
  set_labels(snapshot, *structure, row_of_entity);
  for (const u32 entity :
       shown_among(snapshot, [](const Entity& entity) { return bool(entity.volume); }))
    structure->volumes.push_back({entity, row_of_entity[entity]});

  structure->slot_of_entity.assign(snapshot.entities.capacity(), kNone);
  for_each_shown(snapshot, [&](u32 index, const Entity& entity, const Mesh& mesh) {
    structure->slot_of_entity[index] = u32(structure->slots.size());
    structure->slots.push_back({.entity = index,
                                .mesh = position[mesh_number(snapshot, entity)],
                                .first_part = u32(structure->part_materials.size()),
                                .row = row_of_entity[index],
                                .scale = shown_scale(entity),
                                .deforms = deforms(entity, mesh)});
    add_materials(snapshot, entity, mesh.topology->part_count, structure->part_materials);
  });
  set_lists(snapshot, *structure);
  return structure;
}

}  // namespace heliograph::resident
