// One numbered transaction, as Apply and ApplyStream do it. Implemented in service_edit.cpp.
#pragma once

#include <functional>

#include "server/calls/daemon.h"

namespace heliograph::server {

/// Runs the request in the strand of its session and scene and calls `done` once, from any thread.
/// An error instead of a reply that is kept (gap, unknown scene, full queue) does not use the
/// number up.
///
/// may_take_long   the caller's thread may be busy with it
void apply_numbered(Daemon& daemon, const std::shared_ptr<Session>& session,
                    const v1::ApplyRequest& request,
                    const std::function<void(EditLog::Reply)>& done, bool may_take_long = false);

}  // namespace heliograph::server
