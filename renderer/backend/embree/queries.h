// Spatial questions on Embree: rays, picks, visibility, overlap, surface samples.
#pragma once

#include "renderer/backend/embree/placement.h"
#include "renderer/backend/embree/tracer.h"
#include "renderer/engine/backend.h"

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
[[nodiscard]] Expected<QueryResult> answer(const QueryScene& scene, const QueryJob& job,
                                           const Interrupt& interrupt);

}  // namespace heliograph::embree
