// One numbered transaction, as Apply and ApplyStream do it. Implemented in service_edit.cpp.
#pragma once

#include <functional>

#include "server/calls/daemon.h"

namespace heliograph::server {

/// Runs a request in the strand of its session and scene and calls `done` once, from any thread. An
/// error that is not a kept reply (gap, unknown scene, full queue) does not use up the number.
///
/// may_take_long   the caller's thread may run a long edit itself
void apply_numbered(Daemon& daemon, const std::shared_ptr<Session>& session,
                    const v1::ApplyRequest& request,
                    const std::function<void(EditLog::Reply)>& done, bool may_take_long = false);

}  // namespace heliograph::server
