// SIGTERM and SIGINT: the event loop handles them; after its end they cut the shutdown short.
#pragma once

#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Blocks the signals and returns a signalfd. Called before any thread starts, so that all inherit
/// the mask.
[[nodiscard]] UniqueFd block_signals();

/// Ends the process soon, with kExitOk, whatever hangs: the effect of a second signal. Acknowledged
/// records of the journal are on the disk.
void hurry();

/// Makes a signal call hurry() from now on, in the calling thread.
void hurry_at_signal();

}  // namespace heliograph::server
