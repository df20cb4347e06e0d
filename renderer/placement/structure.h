// Structure of a snapshot by its entities and meshes, without poses: one slot for each entity that
// shows a mesh, in the order of entity indices. The order of slots is the order of instances.
#pragma once

#include "renderer/placement/mesh.h"
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

/// The children of each entity, alive or not: those of entity i are `of` from first[i] to
/// first[i + 1]. Empty where no entity has a parent.
struct Children {
  std::vector<u32> first;
  std::vector<u32> of;
};

struct Structure {
  std::vector<Slot> slots;
  std::vector<u32> slot_of_entity;  // kNone: shows nothing
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;
  std::vector<u32> deforming;  // slots that do
  std::vector<u32> fixed;      // slots of static entities that do not
  Children children;
  std::vector<u32> keyed;           // entities with pose keys
  std::vector<u32> row_of_root;     // by entity: the row whose root it is, or kNone
  std::vector<std::string> groups;  // names of the light groups by index; the first is ""
  std::vector<u32> group_of_slot;
  std::vector<u32> group_of_volume;  // of `volumes`
  // Row of the material table; its capacity: the default material; one more: absorbs all light.
  std::vector<u32> part_materials;
  std::vector<u32> suns;     // entities that are shown and have a sun
  std::vector<u32> idle;     // shown, with a light that is no sun and has nothing to shine from
  std::vector<u32> portals;  // entities that are shown and have a portal
  std::vector<VolumeSlot> volumes;  // entities that are shown and have a volume
  Labelling labelling;
};

/// True if two snapshots have the same structure, row by row where their tables differ.
[[nodiscard]] bool same_structure(const Snapshot& a, const Snapshot& b);

/// The entities that are given, with all beneath them: ascending, if they are.
[[nodiscard]] std::vector<u32> with_descendants(const Structure& structure,
                                                std::vector<u32> entities);

/// Builds the structure, missing acceleration structures in parallel.
[[nodiscard]] Expected<std::shared_ptr<const Structure>> make_structure(const Snapshot& snapshot,
                                                                        const MeshBuilder& builder);

}  // namespace heliograph::resident
