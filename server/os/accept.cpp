// Binding, accepting and counting connections. Called by main.
#include "server/os/accept.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <grp.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <vector>

#include "server/os/own_folder.h"

namespace heliograph::server {
namespace {

constexpr int kBacklog = 128;
constexpr auto kAcceptPause = std::chrono::milliseconds(100);
constexpr int kAcceptsPerRound = 64;
constexpr u64 kRefused = ~u64(0) - 1;  // sender of descriptors from refused users

std::unexpected<Error> system_error(const std::string& what) {
  return fail(Code::kUnavailable, "", what + ": " + std::strerror(errno));
}

Status give_to_group(const std::string& path, gid_t group, mode_t mode) {
  if (::chown(path.c_str(), uid_t(-1), group) == 0 && ::chmod(path.c_str(), mode) == 0) return {};
  return fail(
      Code::kPermissionDenied, "--socket-group",
      fmt::format("cannot give {} to group {}: {}; the daemon's user must be a member of it", path,
                  group, std::strerror(errno)));
}

/// Opens the folder of a socket; creates it, private or for the group, when it does not exist.
Expected<UniqueFd> open_folder(const std::filesystem::path& folder, std::optional<gid_t> group) {
  if (::mkdir(folder.c_str(), 0700) == 0) {
    if (group) HELIO_TRY(give_to_group(folder.string(), *group, 0750));
  } else if (errno != EEXIST) {
    return system_error("cannot make the socket's folder " + folder.string());
  }
  return open_own_folder(folder.string(), Others::kMayRead, "--socket");
}

/// Returns true when the peer of a Unix socket is in the group, primary or supplementary.
bool is_member(int connection, gid_t first, gid_t group) {
  if (first == group) return true;
  std::vector<gid_t> groups(64);
  socklen_t size = socklen_t(groups.size() * sizeof(gid_t));
  if (::getsockopt(connection, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &size) != 0) {
    if (errno != ERANGE) return false;
    groups.resize(size / sizeof(gid_t));
    if (::getsockopt(connection, SOL_SOCKET, SO_PEERGROUPS, groups.data(), &size) != 0)
      return false;
  }
  groups.resize(size / sizeof(gid_t));
  return std::ranges::find(groups, group) != groups.end();
}

/// Makes the kernel refuse descriptors: gRPC uses none, and the kernel would close them in gRPC's
/// threads. Accepted connections inherit this.
void refuse_descriptors(int fd) {
  constexpr int kPassRights = 83;  // SO_PASSRIGHTS of Linux 6.16; older kernels refuse it
  const int no = 0;
  ::setsockopt(fd, SOL_SOCKET, kPassRights, &no, sizeof no);
}

/// Shuts a Unix connection down and drains it. Returns true when close() cannot block: no
/// descriptor is left in its queue. A packet without bytes looks like the end, but for the
/// credentials beside it.
bool is_clean(int fd) {
  const int yes = 1;
  int type = 0;
  socklen_t size = sizeof type;
  ::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size);
  ::setsockopt(fd, SOL_SOCKET, SO_PASSCRED, &yes, sizeof yes);
  ::shutdown(fd, SHUT_RDWR);
  char byte = 0;
  iovec piece{&byte, 1};
  msghdr message{};
  message.msg_iov = &piece;
  message.msg_iovlen = 1;
  if (::recvmsg(fd, &message, MSG_PEEK | MSG_DONTWAIT) != 0) return false;
  return type == SOCK_STREAM || (message.msg_flags & MSG_CTRUNC) == 0;
}

bool answers(const sockaddr_un& address, int type) {
  const UniqueFd probe(::socket(AF_UNIX, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (::connect(probe.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0)
    return true;
  return errno == EAGAIN || errno == EINPROGRESS;  // a full backlog: a daemon listens
}

/// Returns the peer's network: the /64 of an IPv6 address, which one host may own; an IPv4 address
/// in IPv6 as that address.
std::string network_of(int connection) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  if (::getpeername(connection, reinterpret_cast<sockaddr*>(&storage), &size) != 0) return "";
  char text[INET6_ADDRSTRLEN] = "";
  if (storage.ss_family == AF_INET) {
    const auto* v4 = reinterpret_cast<const sockaddr_in*>(&storage);
    ::inet_ntop(AF_INET, &v4->sin_addr, text, sizeof text);
    return text;
  }
  in6_addr address = reinterpret_cast<const sockaddr_in6*>(&storage)->sin6_addr;
  if (IN6_IS_ADDR_V4MAPPED(&address)) {
    ::inet_ntop(AF_INET, &address.s6_addr[12], text, sizeof text);
    return text;
  }
  std::fill(address.s6_addr + 8, address.s6_addr + 16, u8(0));
  ::inet_ntop(AF_INET6, &address, text, sizeof text);
  return text;
}

Expected<sockaddr_storage> parse_address(const std::string& address, socklen_t& size) {
  const auto colon = address.rfind(':');
  const std::string host = address.substr(0, colon);
  u16 port = 0;
  const char* end = address.data() + address.size();
  const auto parsed = colon == std::string::npos
                          ? std::from_chars_result{nullptr, std::errc::invalid_argument}
                          : std::from_chars(address.data() + colon + 1, end, port);
  if (parsed.ec != std::errc() || parsed.ptr != end)
    return fail(Code::kInvalidArgument, "--listen",
                "'" + address + "' is not ADDRESS:PORT, for example 127.0.0.1:7443");
  sockaddr_storage storage{};
  auto* v4 = reinterpret_cast<sockaddr_in*>(&storage);
  auto* v6 = reinterpret_cast<sockaddr_in6*>(&storage);
  if (::inet_pton(AF_INET, host.c_str(), &v4->sin_addr) == 1) {
    v4->sin_family = AF_INET;
    v4->sin_port = htons(port);
    size = sizeof *v4;
    return storage;
  }
  storage = {};
  const bool is_bracketed = host.starts_with('[') && host.ends_with(']');
  if (is_bracketed &&
      ::inet_pton(AF_INET6, host.substr(1, host.size() - 2).c_str(), &v6->sin6_addr) == 1) {
    v6->sin6_family = AF_INET6;
    v6->sin6_port = htons(port);
    size = sizeof *v6;
    return storage;
  }
  return fail(Code::kInvalidArgument, "--listen",
              "'" + address + "' has no numerical address; write 127.0.0.1:7443 or [::1]:7443");
}

}  // namespace

Expected<gid_t> find_group(const std::string& group) {
  gid_t number = 0;
  const char* end = group.data() + group.size();
  const auto parsed = std::from_chars(group.data(), end, number);
  if (parsed.ec == std::errc() && parsed.ptr == end) return number;
  if (const struct group* found = ::getgrnam(group.c_str())) return found->gr_gid;
  return fail(Code::kInvalidArgument, "--socket-group",
              "there is no group '" + group + "'; name one of /etc/group, or its number");
}

Expected<ListeningSocket> listen_unix(const std::string& path, int type,
                                      std::optional<gid_t> group) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof address.sun_path)
    return fail(Code::kInvalidArgument, "--socket",
                fmt::format("'{}' has {} bytes; a socket's path may have {}. Choose a shorter one",
                            path, path.size(), sizeof address.sun_path - 1));
  path.copy(address.sun_path, sizeof address.sun_path - 1);
  auto folder = open_folder(std::filesystem::absolute(path).parent_path(), group);
  if (!folder) return std::unexpected(folder.error());
  ::flock(folder->get(),
          LOCK_EX);  // until the folder is closed: daemons that start decide one at a time
  if (answers(address, type))
    return fail(Code::kAlreadyExists, "--socket",
                "a daemon already listens on " + path + "; stop it or choose another --socket");
  struct stat info{};
  if (::lstat(path.c_str(), &info) == 0 && !S_ISSOCK(info.st_mode))
    return fail(Code::kAlreadyExists, "--socket", path + " exists and is not a socket");
  ::unlink(path.c_str());
  UniqueFd fd(::socket(AF_UNIX, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  if (type == SOCK_STREAM) refuse_descriptors(fd.get());
  const mode_t old_mask = ::umask(0177);
  const int bound = ::bind(fd.get(), reinterpret_cast<sockaddr*>(&address), sizeof address);
  ::umask(old_mask);
  if (bound != 0) return system_error("cannot bind " + path);
  if (group) HELIO_TRY(give_to_group(path, *group, 0660));
  if (::listen(fd.get(), kBacklog) != 0) return system_error("cannot listen on " + path);
  return ListeningSocket{.fd = std::move(fd), .group = group};
}

Expected<bool> is_loopback(const std::string& address) {
  socklen_t size = 0;
  const auto storage = parse_address(address, size);
  if (!storage) return std::unexpected(storage.error());
  if (storage->ss_family == AF_INET) {
    const auto* v4 = reinterpret_cast<const sockaddr_in*>(&*storage);
    return (ntohl(v4->sin_addr.s_addr) >> 24) == 127;
  }
  const auto* v6 = reinterpret_cast<const sockaddr_in6*>(&*storage);
  return IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr) != 0;
}

Expected<ListeningSocket> listen_tcp(const std::string& address) {
  socklen_t size = 0;
  auto storage = parse_address(address, size);
  if (!storage) return std::unexpected(storage.error());
  UniqueFd fd(::socket(storage->ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  const int one = 1;
  ::setsockopt(fd.get(), SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  if (::bind(fd.get(), reinterpret_cast<sockaddr*>(&*storage), size) != 0 ||
      ::listen(fd.get(), kBacklog) != 0)
    return system_error("cannot listen on " + address);
  return ListeningSocket{.fd = std::move(fd)};
}

std::string local_address(int fd) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  ::getsockname(fd, reinterpret_cast<sockaddr*>(&storage), &size);
  char text[INET6_ADDRSTRLEN] = "";
  if (storage.ss_family == AF_INET6) {
    const auto* v6 = reinterpret_cast<sockaddr_in6*>(&storage);
    ::inet_ntop(AF_INET6, &v6->sin6_addr, text, sizeof text);
    return fmt::format("[{}]:{}", text, ntohs(v6->sin6_port));
  }
  const auto* v4 = reinterpret_cast<sockaddr_in*>(&storage);
  ::inet_ntop(AF_INET, &v4->sin_addr, text, sizeof text);
  return fmt::format("{}:{}", text, ntohs(v4->sin_port));
}

// ---------------------------------------------------------------- Listener

Expected<std::unique_ptr<Listener>> Listener::start(EventLoop& loop, const Log& log,
                                                    ListeningSocket socket, Take take) {
  std::unique_ptr<Listener> listener(new Listener(loop, log, std::move(socket), std::move(take)));
  HELIO_TRY(listener->resume());
  return listener;
}

Listener::Listener(EventLoop& loop, const Log& log, ListeningSocket socket, Take take)
    : loop_(loop), log_(log), socket_(std::move(socket)), take_(std::move(take)) {
  int domain = 0;
  socklen_t size = sizeof domain;
  ::getsockopt(socket_.fd.get(), SOL_SOCKET, SO_DOMAIN, &domain, &size);
  is_unix_ = domain == AF_UNIX;
}

Listener::~Listener() { loop_.forget(socket_.fd.get()); }

Status Listener::resume() {
  return loop_.watch(socket_.fd.get(), EPOLLIN, [this](u32) { accept_some(); });
}

void Listener::pause() {
  loop_.forget(socket_.fd.get());
  loop_.after(kAcceptPause, [this, alive = std::weak_ptr(alive_)] {
    if (alive.expired()) return;
    if (auto status = resume(); !status) pause();
  });
}

void Listener::accept_some() {
  for (int i = 0; i < kAcceptsPerRound; ++i) {
    if (loop_.closer().is_full()) return pause();
    UniqueFd accepted(::accept4(socket_.fd.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
    if (!accepted) {
      if (errno == EAGAIN || errno == EINTR || errno == ECONNABORTED) return;
      log_.warning("accepting connections pauses", {{"reason", std::strerror(errno)}});
      return pause();
    }
    const auto peer = admit(accepted.get());
    const u64 sender = peer ? peer->sender() : kRefused;
    const bool is_full = is_unix_ && loop_.closer().is_full(sender);
    if (is_full && is_clean(accepted.get())) continue;  // otherwise the closer takes it
    ForeignFd connection(loop_.closer(), std::move(accepted), sender);
    if (peer && !is_full) take_(std::move(connection), *peer);
  }
}

std::optional<Peer> Listener::admit(int connection) const {
  if (!is_unix_) {
    const int one = 1;
    ::setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    Peer peer{.network = network_of(connection)};
    if (peer.network.empty()) return std::nullopt;  // the peer has hung up
    return peer;
  }
  ucred credentials{};
  socklen_t size = sizeof credentials;
  if (::getsockopt(connection, SOL_SOCKET, SO_PEERCRED, &credentials, &size) != 0)
    return std::nullopt;
  const Peer peer{.process = credentials.pid, .network = {}};
  if (credentials.uid == ::geteuid()) return peer;
  if (socket_.group && is_member(connection, credentials.gid, *socket_.group)) return peer;
  log_.warning("connection of another user refused", {{"uid", credentials.uid}});
  return std::nullopt;
}

// ---------------------------------------------------------------- ConnectionCount

ConnectionCount::~ConnectionCount() {
  for (const auto& [fd, entry] : open_) loop_.forget(fd);
}

bool ConnectionCount::has_room(const Peer& peer) const {
  if (open_.size() >= limits_.total) return false;
  if (!peer.is_local() && remote_ >= limits_.total - limits_.total / 4) return false;
  const auto found = by_peer_.find(peer);
  return peer == Peer() || found == by_peer_.end() || found->second < limits_.per_peer;
}

bool ConnectionCount::add(int connection, const Peer& peer) {
  if (!has_room(peer)) return false;
  UniqueFd duplicate(::fcntl(connection, F_DUPFD_CLOEXEC, 0));
  const int fd = duplicate.get();
  if (!duplicate) return false;
  if (!loop_.watch(fd, 0, [this, fd](u32) { remove(fd); })) return false;
  open_.emplace(fd, Entry{ForeignFd(loop_.closer(), std::move(duplicate), peer.sender()), peer});
  ++by_peer_[peer];
  if (!peer.is_local()) ++remote_;
  return true;
}

void ConnectionCount::remove(int duplicate) {
  const auto found = open_.find(duplicate);
  if (!found->second.peer.is_local()) --remote_;
  if (const auto peer = by_peer_.find(found->second.peer); --peer->second == 0)
    by_peer_.erase(peer);
  loop_.forget(duplicate);
  open_.erase(found);
}

}  // namespace heliograph::server
