// What the worlds of a request do not share, checked. Called by render_task.cpp.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/scene/worlds.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

struct WorldLimits {
  u64 worlds;  // of a request
  u64 edits;   // of an overlay
};

/// scene   the request's, with its overlay: poses name its entities
///
/// Fails with INVALID_ARGUMENT, NOT_FOUND, RESOURCE_EXHAUSTED, `where` beneath
/// RenderRequest.worlds. Whether overlays fit the scene is not looked at.
[[nodiscard]] Expected<Worlds> to_worlds(const v1::Worlds& message, const Snapshot& scene,
                                         ArraySource& source, const WorldLimits& limits);

}  // namespace heliograph::server
