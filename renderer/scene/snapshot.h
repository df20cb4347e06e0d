// One revision of a scene, immutable and shared. Everything that renders or reads works on one.
#pragma once

#include <memory>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/error.h"
#include "renderer/scene/components.h"
#include "renderer/scene/names.h"
#include "renderer/scene/persistent_map.h"
#include "renderer/scene/table.h"

namespace heliograph {

/// Objects that the scene keeps of an instantiated asset: the shared ones that it created, so that
/// the next instance uses them again. In the order of Asset::library; ids may have gone stale.
using Library = std::vector<Id>;

/// Lives as long as a Scene does: what is made of its snapshots need not outlive it.
struct SceneLife {
  bool is_pinned = false;  // what a device has of it stays there, however full that is
};

/// Thread: any, once it is const. Copying costs one pointer a chunk.
struct Snapshot {
  std::weak_ptr<const SceneLife> scene;  // that it is a revision or a world of; empty: of none
  Revision revision = 0;
  Time time = 0;

  Table<Entity> entities;
  ChunkedArray<mat4x3> poses;  // local pose by entity index, at `time`; identity where not alive
  Table<Shared<Mesh>> meshes;
  Table<Shared<Material>> materials;
  Table<Shared<Texture>> textures;
  Table<Shared<Volume>> volumes;
  std::shared_ptr<const Dome> dome;  // null: none

  Names names;
  PersistentMap<u32, u32> labels;  // value -> how many entities state it themselves
  u32 next_label = 1;
  std::shared_ptr<const std::vector<std::string>> categories;  // class id - 1 -> name; may be null
  PersistentMap<std::string, std::shared_ptr<const Library>> libraries;  // by asset hash

  u32 keyed = 0;  // entities with pose keys
  u64 array_bound =
      0;  // bytes of all arrays, shared ones counted at each use: no less than the truth

  /// The state before the last Advance, at its own time; its own `previous` is null. Setting the
  /// time by other means forgets it.
  std::shared_ptr<const Snapshot> previous;
  u64 advances = 0;  // how many led here

  [[nodiscard]] const Entity* find(EntityId id) const {
    return entities.find(id.version(), id.index());
  }
  [[nodiscard]] const Shared<Mesh>* find(MeshId id) const {
    return meshes.find(id.version(), id.index());
  }
  [[nodiscard]] const Shared<Material>* find(MaterialId id) const {
    return materials.find(id.version(), id.index());
  }
  [[nodiscard]] const Shared<Texture>* find(TextureId id) const {
    return textures.find(id.version(), id.index());
  }
  [[nodiscard]] const Shared<Volume>* find(VolumeId id) const {
    return volumes.find(id.version(), id.index());
  }
  /// True if an id of any kind names a live object.
  [[nodiscard]] bool alive(Id id) const;
  [[nodiscard]] EntityId entity_id(u32 index) const {
    return EntityId::make(entities.version(index), index);
  }

  /// The object of that name and kind, or of any kind, entities first. NOT_FOUND lists the nearest
  /// names; INVALID_ARGUMENT when objects of other kinds alone have it.
  [[nodiscard]] Expected<Id> find(std::string_view name, Kind kind = Kind::kNone) const;
  /// Its name, or "" when it has none or is not alive.
  [[nodiscard]] std::string name_of(Id id) const;
};

/// Names of the light groups of its entities and its dome, but for "".
[[nodiscard]] std::set<std::string> light_groups(const Snapshot& snapshot);

}  // namespace heliograph
