// Minimal HTTP/1.1 on the event loop. See metrics_port.h.
#include "server/net/metrics_port.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace heliograph::server {
namespace {

constexpr std::size_t kLongestRequest = 8192;
constexpr auto kLongest = std::chrono::seconds(5);
constexpr int kBacklog = 8;

std::string http(std::string_view status, std::string_view body) {
  return fmt::format(
      "HTTP/1.1 {}\r\nContent-Type: text/plain; version=0.0.4; charset=utf-8\r\n"
      "Content-Length: {}\r\nX-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n{}",
      status, body.size(), body);
}

using Address = std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)>;

/// Parses a numeric address and port; null for anything else.
Address parse(const std::string& address) {
  const auto colon = address.rfind(':');
  if (colon == std::string::npos || colon == 0) return {nullptr, ::freeaddrinfo};
  std::string host = address.substr(0, colon);
  if (host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  addrinfo hints{};
  hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV | AI_PASSIVE;
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  ::getaddrinfo(host.c_str(), address.c_str() + colon + 1, &hints, &found);
  return {found, ::freeaddrinfo};
}

}  // namespace

Expected<ListeningSocket> listen_for_metrics(const std::string& address) {
  const Address found = parse(address);
  if (!found)
    return fail(Code::kInvalidArgument, "--metrics",
                "'" + address + "' is not ADDRESS:PORT with numbers, for example 127.0.0.1:9464");
  UniqueFd fd(::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int one = 1;
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  if (::bind(fd.get(), found->ai_addr, found->ai_addrlen) != 0 || ::listen(fd.get(), kBacklog) != 0)
    return fail(Code::kUnavailable, "--metrics",
                "cannot listen on " + address + ": " + std::strerror(errno));
  return ListeningSocket{.fd = std::move(fd)};
}

bool is_loopback(int fd) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&storage), &size);
  if (storage.ss_family == AF_INET6)
    return IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<sockaddr_in6*>(&storage)->sin6_addr);
  return ntohl(reinterpret_cast<sockaddr_in*>(&storage)->sin_addr.s_addr) >> 24 == 127;
}

Expected<std::unique_ptr<MetricsPort>> MetricsPort::start(Options options, Page page) {
  std::unique_ptr<MetricsPort> port(new MetricsPort(options.loop, options.limits, std::move(page)));
  auto listener = Listener::start(options.loop, options.log, std::move(options.socket),
                                  [self = port.get()](ForeignFd connection, const Peer& peer) {
                                    self->take(std::move(connection), peer.network);
                                  });
  if (!listener) return std::unexpected(listener.error());
  port->listener_ = std::move(*listener);
  return port;
}

MetricsPort::~MetricsPort() {
  for (const auto& [fd, connection] : open_) loop_.forget(fd);
}

/// Closes the oldest connection without a complete request, of the same address where that has used
/// up its share. False when all of these are being answered.
bool MetricsPort::make_room(const std::string& peer) {
  const auto is_same = [&](const auto& entry) { return entry.second.peer == peer; };
  const bool is_share_full = u32(std::ranges::count_if(open_, is_same)) >= limits_.per_peer;
  if (!is_share_full && open_.size() < limits_.total) return true;
  const Connection* oldest = nullptr;
  for (const auto& [fd, connection] : open_) {
    if (!connection.reply.empty() || (is_share_full && connection.peer != peer)) continue;
    if (!oldest || connection.number < oldest->number) oldest = &connection;
  }
  if (oldest) close(oldest->fd.get());
  return oldest;
}

void MetricsPort::take(ForeignFd fd, const std::string& peer) {
  if (!make_room(peer)) return;
  const int number = fd.get();
  if (!loop_.watch(number, EPOLLIN, [this, number](u32) { on_event(number); })) return;
  const u64 serial = ++last_number_;
  open_.emplace(number, Connection{std::move(fd), peer, serial, {}, {}});
  loop_.after(kLongest, [this, number, serial, alive = std::weak_ptr(alive_)] {
    if (alive.expired()) return;
    const auto found = open_.find(number);
    if (found != open_.end() && found->second.number == serial) close(number);
  });
}

void MetricsPort::on_event(int fd) {
  Connection& connection = open_.at(fd);
  if (connection.reply.empty())
    read(connection);
  else
    write(connection);
}

void MetricsPort::read(Connection& connection) {
  const int fd = connection.fd.get();
  std::array<char, 4096> buffer;
  const ssize_t size = ::recv(fd, buffer.data(), buffer.size(), 0);
  if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (size > 0) connection.request.append(buffer.data(), std::size_t(size));
  if (size <= 0 || connection.request.size() > kLongestRequest) return close(fd);
  if (connection.request.find("\r\n\r\n") == std::string::npos) return;
  const std::string_view line =
      std::string_view(connection.request).substr(0, connection.request.find("\r\n"));
  if (!line.starts_with("GET "))
    connection.reply = http("405 Method Not Allowed", "GET only\n");
  else if (line.starts_with("GET /metrics "))
    connection.reply = http("200 OK", page_());
  else
    connection.reply = http("404 Not Found", "/metrics is what there is\n");
  loop_.forget(fd);
  if (!loop_.watch(fd, EPOLLOUT, [this, fd](u32) { on_event(fd); })) return close(fd);
}

void MetricsPort::write(Connection& connection) {
  const int fd = connection.fd.get();
  const ssize_t sent =
      ::send(fd, connection.reply.data(), connection.reply.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (sent < 0 && (errno == EAGAIN || errno == EINTR)) return;
  if (sent > 0) connection.reply.erase(0, std::size_t(sent));
  if (sent <= 0 || connection.reply.empty()) close(fd);
}

void MetricsPort::close(int fd) {
  loop_.forget(fd);
  open_.erase(fd);
}

}  // namespace heliograph::server
