// A scene as it was, ids included: what the journal's snapshots need beyond a description.
#pragma once

#include "renderer/scene/scene.h"

namespace heliograph {

/// Numbers by which a scene goes on: a SceneDescription leaves them out.
struct SceneNumbers {
  Revision revision = 0;
  u64 advances = 0;
  u32 next_label = 1;
  TableIds entities, meshes, materials, textures, volumes;
  /// Indices of entities that state no label, though describe() gives them one (it shows the same,
  /// but an ancestor that gets a label later would count).
  std::vector<u32> without_label;
};
[[nodiscard]] SceneNumbers numbers(const Snapshot& snapshot);

/// The snapshot with that description and these numbers. Every further transaction does to it what
/// it does to the one that was described. Fails as rebuild() does; INVALID_ARGUMENT at "numbers"
/// when they are of another scene.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> restore(const SceneDescription& description,
                                                                const SceneNumbers& numbers,
                                                                const SceneLimits& limits);

}  // namespace heliograph
