// Spatial questions on Embree: rays, picks, visibility, overlap, surface samples, tracks.
#pragma once

#include "renderer/backend/embree/tracer.h"
#include "renderer/backend/embree/tracks.h"
#include "renderer/engine/backend.h"
#include "renderer/resident/placement.h"

namespace heliograph::embree {

/// A scene at an instant, as queries see it.
struct QueryScene {
  const Snapshot& snapshot;
  const Placement& placement;
  TracedScene traced;
};

/// Answers with the columns that service.proto names. Fails with NOT_FOUND (an entity that is
/// stale), INVALID_ARGUMENT (an entity without a mesh or a camera, zero directions, nothing to
/// sample), CANCELLED.
/// `scene` is that of the job's time; tracks ask `scene_at` for theirs.
[[nodiscard]] Expected<QueryResult> answer(const QueryScene& scene, const QueryJob& job,
                                           const SceneAt& scene_at, const Interrupt& interrupt);

}  // namespace heliograph::embree
