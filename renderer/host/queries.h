// Spatial questions, answered on the host: rays, picks, visibility, overlap, surface samples,
// tracks.
#pragma once

#include "renderer/host/tracks.h"

namespace heliograph::host {

/// Answers with the columns that service.proto names. Fails with NOT_FOUND (an entity that is
/// stale), INVALID_ARGUMENT (an entity without a mesh or a camera, zero directions, nothing to
/// sample), CANCELLED.
/// `scene` is that of the job's time; tracks ask `scene_at` for theirs.
[[nodiscard]] Expected<QueryResult> answer(const SceneRays& scene, const QueryJob& job,
                                           const SceneAt& scene_at, const Interrupt& interrupt);

}  // namespace heliograph::host
