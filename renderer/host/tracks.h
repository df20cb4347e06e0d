// Points of surfaces followed over time. Called by queries.cpp.
#pragma once

#include <functional>

#include "renderer/host/tracer.h"

namespace heliograph::host {

/// The scene at a time.
using SceneAt = std::function<Expected<SceneRays>(Time)>;

/// Answers with the columns of service.proto's TracksReply. Fails as the scenes do, with
/// INVALID_ARGUMENT for an entity that shows no mesh, and as the interrupt does.
[[nodiscard]] Expected<QueryResult> follow(const Tracks& tracks, const SceneAt& scene_at,
                                           const Interrupt& interrupt);

}  // namespace heliograph::host
