// A scene replicated: what its copies do not share. Made in server/convert, read by the engine.
#pragma once

#include "renderer/scene/scene.h"

namespace heliograph {

/// N copies of a scene, numbered from 0. All are described here; those that are rendered share what
/// their snapshots share.
struct Worlds {
  u32 count = 0;                      // N
  std::vector<EntityId> entities;     // M, whose local poses differ
  std::vector<mat4x3> poses;          // (N, M)
  bool teleport = false;              // of these poses
  std::vector<Transaction> overlays;  // of the first worlds: edits after their poses
  std::vector<u32> rendered;          // which ones to render, ascending
  SceneLimits limits;

  [[nodiscard]] bool has_overlay(u32 world) const {
    return world < overlays.size() && !overlays[world].edits.empty();
  }
};

/// The scene of one world, under the revision that it is based on; `scene` itself where nothing
/// differs. Fails as apply() does, with `where` beneath "poses" or "overlays[i]"; INVALID_ARGUMENT
/// for an overlay that changes the time or the classes, which all worlds have in common.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> world_of(
    const std::shared_ptr<const Snapshot>& scene, const Worlds& worlds, u32 world);

}  // namespace heliograph
