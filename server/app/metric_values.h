// The metrics that are states, not events: made when Prometheus asks. Called by lifecycle.cpp.
#pragma once

#include "server/calls/daemon.h"

namespace heliograph::server {

/// connections: open ones. Thread: the loop's.
[[nodiscard]] std::vector<MetricValue> metric_values(const Daemon& daemon, u32 connections);

}  // namespace heliograph::server
