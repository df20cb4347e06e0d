// Listening sockets: bound by the daemon, private by file mode and peer credentials, never starved
// of descriptors. Used for gRPC's connections (accept.cpp hands them over) and for the local
// channel.
#pragma once

#include <sys/types.h>

#include <compare>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

#include "server/os/event_loop.h"
#include "server/os/log.h"

namespace heliograph::server {

/// A listening socket. A Unix socket admits the daemon's user, and members of `group` if there is
/// one.
struct ListeningSocket {
  UniqueFd fd;
  std::optional<gid_t> group = std::nullopt;
};

/// Binds a Unix socket with mode 0600, or 0660 and owned by `group`, and listens. The folder is
/// made with mode 0700, or 0750 and the group, when it does not exist; a stale socket of a dead
/// daemon is replaced.
///
/// type: SOCK_STREAM or SOCK_SEQPACKET. Fails with ALREADY_EXISTS when a daemon answers there,
/// PERMISSION_DENIED when the folder belongs to or is writable by others or the group is not ours
/// to give, INVALID_ARGUMENT when the path is too long for a socket.
[[nodiscard]] Expected<ListeningSocket> listen_unix(const std::string& path, int type,
                                                    std::optional<gid_t> group);

/// Returns the id of a group given by name or number. INVALID_ARGUMENT when there is none.
[[nodiscard]] Expected<gid_t> find_group(const std::string& group);

/// Listens on a numerical address "127.0.0.1:PORT" or "[::1]:PORT"; port 0 takes a free one.
[[nodiscard]] Expected<ListeningSocket> listen_tcp(const std::string& address);
/// Returns true when an address is reachable from this machine alone. INVALID_ARGUMENT for no
/// address.
[[nodiscard]] Expected<bool> is_loopback(const std::string& address);
/// Returns the address that a TCP listener is bound to, as "127.0.0.1:PORT".
[[nodiscard]] std::string local_address(int fd);

/// The other end of a connection.
struct Peer {
  pid_t process = 0;    // over the Unix socket; 0: of another PID namespace
  std::string network;  // over TCP: the IPv4 address, or the IPv6 /64; "": Unix
  [[nodiscard]] bool is_local() const { return network.empty(); }
  /// Returns the sender of its descriptors (closer.h). Nothing over TCP makes close() hang, so all
  /// TCP peers are one sender.
  [[nodiscard]] u64 sender() const { return is_local() ? u64(process) : ~u64(0); }
  friend std::strong_ordering operator<=>(const Peer&, const Peer&) = default;
};

/// Accepts connections of one listening socket and passes them on. Owns: the listener. Thread: the
/// loop's.
///
/// Closes Unix peers without permission, and peers whose quota of descriptors waiting to be closed
/// is used up. Out of descriptors, or while the quota of all peers is used up, it pauses instead of
/// spinning.
class Listener {
 public:
  using Take = std::function<void(ForeignFd connection, const Peer& peer)>;

  [[nodiscard]] static Expected<std::unique_ptr<Listener>> start(EventLoop& loop, const Log& log,
                                                                 ListeningSocket socket, Take take);
  ~Listener();

 private:
  Listener(EventLoop& loop, const Log& log, ListeningSocket socket, Take take);
  [[nodiscard]] Status resume();
  void accept_some();
  void pause();
  [[nodiscard]] std::optional<Peer> admit(int connection) const;

  EventLoop& loop_;
  const Log& log_;
  ListeningSocket socket_;
  Take take_;
  bool is_unix_ = false;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // timers check it
};

/// Counts connections that gRPC owns. Owns: a duplicate of each, which reports the hang-up. Thread:
/// the loop's.
///
/// A quarter of `total` is reserved for the Unix socket: TCP peers, which may not even have a
/// token, cannot shut out the daemon's owner. Processes that the kernel does not name have no limit
/// of their own.
class ConnectionCount {
 public:
  struct Limits {
    u32 total = 256;
    u32 per_peer = 64;
  };
  ConnectionCount(EventLoop& loop, Limits limits) : loop_(loop), limits_(limits) {}
  ~ConnectionCount();

  /// Counts a connection. False: the caller closes it.
  [[nodiscard]] bool add(int connection, const Peer& peer);
  [[nodiscard]] u32 open() const { return u32(open_.size()); }

 private:
  [[nodiscard]] bool has_room(const Peer& peer) const;
  void remove(int duplicate);

  EventLoop& loop_;
  const Limits limits_;
  struct Entry {
    ForeignFd fd;
    Peer peer;
  };
  std::unordered_map<int, Entry> open_;
  std::map<Peer, u32> by_peer_;
  u32 remote_ = 0;  // open connections over TCP
};

}  // namespace heliograph::server
