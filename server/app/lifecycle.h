// The daemon from listening to exit: sockets, signals, the owner, readiness and drain. Called by
// main.
#pragma once

#include "server/config/config.h"

namespace heliograph::server {

/// Runs the daemon; returns its exit status (ExitCode).
[[nodiscard]] int run(Config config);

}  // namespace heliograph::server
