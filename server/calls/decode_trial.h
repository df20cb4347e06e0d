// Whether files can be decoded, found out when the daemon starts. Used by lifecycle.cpp.
#pragma once

#include "server/calls/daemon.h"

namespace heliograph::server {

/// What the settings say of the decoder.
[[nodiscard]] DecoderOptions decoder_options(const Config& config);

/// Decodes a triangle, again every few seconds until that works, and tells the daemon's health and
/// log. Called by the loop; the daemon outlives what it starts.
void try_decoder(Daemon& daemon);

}  // namespace heliograph::server
