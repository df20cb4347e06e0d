// heliographd --probe: asks a daemon for its health, for containers and scripts. Called by main.
#pragma once

#include "server/config/config.h"

namespace heliograph::server {

/// Queries the health service at config.socket for config.probe, for at most 2 s. Returns kExitOk
/// when it serves, else kExitNotHealthy with a line on stderr.
[[nodiscard]] int probe(const Config& config);

}  // namespace heliograph::server
