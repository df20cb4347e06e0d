// SIGTERM and SIGINT: the event loop hears them, and once it has ended they hurry the end.
#pragma once

#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Called before any thread starts, so that all inherit it; a signalfd.
[[nodiscard]] UniqueFd block_signals();

/// What a second signal asks for: the process ends soon, with kExitOk, whatever hangs. What the
/// journal acknowledged is on the disk.
void hurry();

/// From now on a signal does that, in the calling thread.
void hurry_at_signal();

}  // namespace heliograph::server
