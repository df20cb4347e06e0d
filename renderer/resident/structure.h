// What the entities and meshes of a snapshot say, without poses: one slot for each entity that
// shows a mesh, in the order of entity indices. The order of slots is the order of instances.
#pragma once

#include "renderer/resident/mesh.h"
#include "renderer/scene/labels.h"

namespace heliograph::resident {

inline constexpr u32 kNone = kernels::kNone;

struct Slot {
  u32 entity;
  u32 mesh;        // index into Structure::meshes
  u32 first_part;  // index into Structure::part_materials
  u32 row;         // index into Labelling::instances, or kNone
  vec3 scale;      // of the mesh, before the entity's pose: a light's shape has a size
  bool deforms;    // keys, morph targets or a skin: deform() may have other vertices
};

struct VolumeSlot {
  u32 entity;
  u32 row;  // index into Labelling::instances, or kNone
};

struct Structure {
  std::vector<Slot> slots;
  std::vector<u32> slot_of_entity;  // kNone: shows nothing
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;
  // Row of the material table; its capacity: the default material; one more: absorbs all light.
  std::vector<u32> part_materials;
  std::vector<u32> suns;            // entities that are shown and have a sun
  std::vector<u32> portals;         // entities that are shown and have a portal
  std::vector<VolumeSlot> volumes;  // entities that are shown and have a volume
  Labelling labelling;
};

/// Builds the structure, missing acceleration structures in parallel.
[[nodiscard]] Expected<std::shared_ptr<const Structure>> make_structure(const Snapshot& snapshot,
                                                                        const MeshBuilder& builder);

}  // namespace heliograph::resident
