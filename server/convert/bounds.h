// World-space boxes of entities with their descendants. Called by read.
#pragma once

#include <optional>
#include <vector>

#include "renderer/scene/snapshot.h"

namespace heliograph::server {

struct Box {
  vec3 min{0}, max{0};
};

/// World poses and children in one snapshot at its time, computed once and used for many entities.
class WorldBoxes {
 public:
  explicit WorldBoxes(const Snapshot& snapshot);

  [[nodiscard]] const mat4x3& pose(u32 entity) const { return poses_[entity]; }
  /// Returns the box of all vertices of an entity and its descendants as posed, morphed and skinned
  /// at the snapshot's time; nullopt where none has a mesh.
  [[nodiscard]] std::optional<Box> of(u32 entity) const;

 private:
  void add(u32 entity, std::optional<Box>& box) const;

  const Snapshot& snapshot_;
  std::vector<mat4x3> poses_;
  std::vector<std::vector<u32>> children_;
};

}  // namespace heliograph::server
