// Notifications to systemd for a unit of Type=notify. Called by lifecycle.cpp.
#pragma once

#include <string>

namespace heliograph::server {

/// Sends "READY=1" or "STOPPING=1" to $NOTIFY_SOCKET, where there is one; see sd_notify(3).
void notify_supervisor(const std::string& state);

}  // namespace heliograph::server
