// Checks the worlds of a request: what differs between them. Called by render_task.cpp.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/scene/worlds.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

struct WorldLimits {
  u64 worlds;  // worlds per request
  u64 edits;   // edits per overlay
};

/// Reads the worlds. INVALID_ARGUMENT, NOT_FOUND, RESOURCE_EXHAUSTED, `where` beneath
/// RenderRequest.worlds. Does not check that overlays fit the scene.
///
/// scene   the request's, with its overlay: poses name its entities
[[nodiscard]] Expected<Worlds> to_worlds(const v1::Worlds& message, const Snapshot& scene,
                                         ArraySource& source, const WorldLimits& limits);

}  // namespace heliograph::server
