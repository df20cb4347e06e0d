// Entities to slots.
#include "renderer/backend/embree/structure.h"

#include <tbb/parallel_for.h>

namespace heliograph::embree {
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

std::vector<u32> shown_suns(const Snapshot& snapshot) {
  std::vector<u32> suns;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (is_sun(entity)) suns.push_back(index);
  });
  if (suns.empty()) return suns;
  const std::vector<u8> shown = visibility_of_all(snapshot);
  std::erase_if(suns, [&](u32 index) { return !shown[index]; });
  return suns;
}

template <class F>
void for_each_shown(const Snapshot& snapshot, F&& f) {
  const std::vector<u8> shown = visibility_of_all(snapshot);
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (!shown[index] || !entity.mesh) return;
    const Shared<Mesh>* row = snapshot.find(entity.mesh);
    if (row && !row->value->topology->triangles.empty()) f(index, entity, *row->value);
  });
}

bool deforms(const Entity& entity, const Mesh& mesh) {
  return mesh.vertices->times.size() > 1 || entity.skin || mesh.topology->morph_count > 0;
}

void add_materials(const Snapshot& snapshot, const Entity& entity, u32 parts,
                   std::vector<u32>& out) {
  const u32 fallback = snapshot.materials.capacity();
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

}  // namespace

std::vector<u32> shown_meshes(const Snapshot& snapshot) {
  std::vector<u32> order;
  std::vector<bool> seen(snapshot.meshes.capacity());
  for_each_shown(snapshot, [&](u32, const Entity& entity, const Mesh&) {
    if (seen[entity.mesh.index()]) return;
    seen[entity.mesh.index()] = true;
    order.push_back(entity.mesh.index());
  });
  return order;
}

Expected<std::shared_ptr<const Structure>> make_structure(const Snapshot& snapshot,
                                                          const MeshBuilder& builder) {
  auto structure = std::make_shared<Structure>();
  const std::vector<u32> rows = shown_meshes(snapshot);
  std::vector<Expected<std::shared_ptr<DeviceMesh>>> built(rows.size());
  tbb::parallel_for(std::size_t(0), rows.size(), [&](std::size_t i) {
    built[i] = builder.build(*snapshot.meshes.at(rows[i]).value);
  });
  std::vector<u32> position(snapshot.meshes.capacity(), kNone);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!built[i])
      return std::unexpected(
          std::move(built[i]).error().at("meshes[" + std::to_string(rows[i]) + "]"));
    position[rows[i]] = u32(i);
    structure->meshes.push_back(*std::move(built[i]));
  }

  structure->suns = shown_suns(snapshot);
  structure->labelling = label_entities(snapshot);
  std::vector<u32> row_of_entity(snapshot.entities.capacity(), kNone);
  for (u32 row = 0; row < structure->labelling.instances.size(); ++row)
    for (const u32 entity : structure->labelling.instances[row].entities)
      row_of_entity[entity] = row;

  structure->slot_of_entity.assign(snapshot.entities.capacity(), kNone);
  for_each_shown(snapshot, [&](u32 index, const Entity& entity, const Mesh& mesh) {
    structure->slot_of_entity[index] = u32(structure->slots.size());
    structure->slots.push_back({index, position[entity.mesh.index()],
                                u32(structure->part_materials.size()), row_of_entity[index],
                                deforms(entity, mesh)});
    add_materials(snapshot, entity, mesh.topology->part_count, structure->part_materials);
  });
  return structure;
}

}  // namespace heliograph::embree
