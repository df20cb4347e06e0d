// Metrics that are states, not events: computed at each scrape. Called by lifecycle.cpp.
#pragma once

#include "server/calls/daemon.h"

namespace heliograph::server {

/// connections   number of open ones
/// Thread: the loop's.
[[nodiscard]] std::vector<MetricValue> metric_values(const Daemon& daemon, u32 connections);

}  // namespace heliograph::server
