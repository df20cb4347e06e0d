// Entities to slots.
#include "renderer/resident/structure.h"

#include "renderer/resident/parallel.h"
#include "renderer/scene/light_shapes.h"

namespace heliograph::resident {
namespace {

/// Whether each entity and all its ancestors are visible, by index. Parents may have any index.
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
    // What hides an ancestor hides all below it, and the last of the chain is the topmost.
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

}  // namespace

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
  structure->portals =
      shown_among(snapshot, [](const Entity& entity) { return bool(entity.portal); });
  structure->labelling = label_entities(snapshot);
  std::vector<u32> row_of_entity(snapshot.entities.capacity(), kNone);
  for (u32 row = 0; row < structure->labelling.instances.size(); ++row)
    for (const u32 entity : structure->labelling.instances[row].entities)
      row_of_entity[entity] = row;
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
  return structure;
}

}  // namespace heliograph::resident
