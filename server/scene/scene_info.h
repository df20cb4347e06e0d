// A scene as clients see it. Used by the handlers that return one.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "server/scene/scenes.h"

namespace heliograph::server {

[[nodiscard]] v1::SceneInfo scene_info(Scenes& scenes, SceneEntry& scene, const Session& session);
/// Updates a stored reply to a call that made a scene, to the scene as it is now.
void bring_up_to_date(Scenes& scenes, const Session& session, v1::SceneInfo& info);
/// Returns the acknowledgement of an edit.
[[nodiscard]] v1::ApplyReply apply_reply(u64 number, const Prepared& prepared);
/// Returns the event of a transaction for Watch. sent: the transaction, serialised.
[[nodiscard]] SceneEvents::Event event_of(std::string_view sent, const Prepared& prepared);

}  // namespace heliograph::server
