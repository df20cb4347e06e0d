// A scene as clients see it. Used by the handlers that return one.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "server/scenes.h"

namespace heliograph::server {

[[nodiscard]] v1::SceneInfo scene_info(Scenes& scenes, SceneEntry& scene, const Session& session);

}  // namespace heliograph::server
