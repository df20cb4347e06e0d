// See sockets.h.
#include "server/app/sockets.h"

#include <sys/socket.h>

#include <filesystem>

#include "server/net/metrics_port.h"

namespace heliograph::server {

Expected<Sockets> open_sockets(const Config& config, SocketFiles& files) {
  Sockets sockets;
  auto main = listen_unix(config.socket, SOCK_STREAM, config.socket_group);
  if (!main) return std::unexpected(main.error());
  files.add(config.socket);
  auto local_channel =
      listen_unix(local_channel_path(config.socket), SOCK_SEQPACKET, config.socket_group);
  if (!local_channel) return std::unexpected(local_channel.error());
  files.add(local_channel_path(config.socket));
  sockets.main = std::move(*main);
  sockets.local_channel = std::move(*local_channel);
  for (const std::string& address : config.listen) {
    auto socket = listen_tcp(address);
    if (!socket) return std::unexpected(socket.error());
    sockets.tcp_addresses.push_back(local_address(socket->fd.get()));
    sockets.tcp.push_back(std::move(*socket));
  }
  if (!config.metrics.empty()) {
    auto metrics = listen_for_metrics(config.metrics);
    if (!metrics) return std::unexpected(metrics.error());
    sockets.metrics = std::move(*metrics);
  }
  if (config.is_private)
    files.remove_folder(std::filesystem::path(config.socket).parent_path().string());
  return sockets;
}

void announce(const Config& config, const Sockets& sockets) {
  std::string tcp;
  for (const std::string& address : sockets.tcp_addresses)
    tcp += fmt::format("{}\"{}\"", tcp.empty() ? "" : ",", address);
  const std::string metrics = sockets.metrics ? local_address(sockets.metrics->fd.get()) : "";
  const std::string line = fmt::format(
      "{{\"socket\":\"{}\",\"lifeline\":\"{}\",\"listen\":[{}],\"metrics\":\"{}\",\"pid\":{}}}\n",
      config.socket, local_channel_path(config.socket), tcp, metrics, ::getpid());
  if (config.ready_fd < 0) return;
  const UniqueFd fd(config.ready_fd);
  [[maybe_unused]] const auto written = ::write(fd.get(), line.data(), line.size());
}

}  // namespace heliograph::server
