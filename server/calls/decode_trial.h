// Tests at the start whether files can be decoded. Used by lifecycle.cpp.
#pragma once

#include "server/calls/daemon.h"

namespace heliograph::server {

/// Returns the decoder's options from the settings.
[[nodiscard]] DecoderOptions decoder_options(const Config& config);

/// Decodes a triangle, repeatedly every few seconds until that works, and reports to the daemon's
/// health and log. Called by the loop; the daemon outlives the trial.
void try_decoder(Daemon& daemon);

}  // namespace heliograph::server
