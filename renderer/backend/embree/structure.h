// What the entities and meshes of a snapshot say, without poses: one slot for each entity that
// shows a mesh, in the order of entity indices. The order of slots is the order of instances.
#pragma once

#include "renderer/backend/embree/mesh.h"
#include "renderer/scene/labels.h"

namespace heliograph::embree {

inline constexpr u32 kNone = kernels::kNone;

struct Slot {
  u32 entity;
  u32 mesh;        // index into Structure::meshes
  u32 first_part;  // index into Structure::part_materials
  u32 row;         // index into Labelling::instances, or kNone
  bool deforms;    // keys, morph targets or a skin: deform() may have other vertices
};

struct Structure {
  std::vector<Slot> slots;
  std::vector<u32> slot_of_entity;  // kNone: shows nothing
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;
  std::vector<u32> part_materials;  // row of the material table; its capacity: the default material
  std::vector<u32> suns;            // entities that are shown and have a sun
  Labelling labelling;
};

/// The meshes that visible entities show, each row once, in order of first use.
[[nodiscard]] std::vector<u32> shown_meshes(const Snapshot& snapshot);

/// Builds the structure, missing acceleration structures in parallel.
[[nodiscard]] Expected<std::shared_ptr<const Structure>> make_structure(const Snapshot& snapshot,
                                                                        const MeshBuilder& builder);

}  // namespace heliograph::embree
