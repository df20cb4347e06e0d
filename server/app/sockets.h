// Listening sockets of the daemon. Called by lifecycle.cpp.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/config/config.h"
#include "server/net/socket_files.h"
#include "server/os/accept.h"

namespace heliograph::server {

/// The listening sockets, bound before anything slow starts.
struct Sockets {
  ListeningSocket main;
  ListeningSocket local_channel;
  std::vector<ListeningSocket> tcp;
  std::vector<std::string> tcp_addresses;
  std::optional<ListeningSocket> metrics;
};

[[nodiscard]] Expected<Sockets> open_sockets(const Config& config, SocketFiles& files);

/// Writes one line of JSON to --ready-fd: clients may connect from now on.
void announce(const Config& config, const Sockets& sockets);

}  // namespace heliograph::server
