// The local channel: a Unix-domain SOCK_SEQPACKET connection.
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "heliograph/error.h"
#include "wire/local_channel.h"

namespace heliograph::client::wire {
namespace {

constexpr std::size_t kTicketBytes = 16;

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw ClientError(Code::kUnavailable, "no daemon listens at " + path + ": " + why +
                                            "; start heliographd, or correct the address");
}

}  // namespace

LocalChannel::LocalChannel(const std::string& path, double seconds) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) refuse(path, "the path is too long for a socket");
  std::memcpy(address.sun_path, path.data(), path.size());
  socket_ = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  timeval limit{};
  const double some = std::max(seconds, 1e-3);  // 0 would be for ever
  limit.tv_sec = time_t(some);
  limit.tv_usec = suseconds_t(1e6 * (some - double(limit.tv_sec)));
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  ::setsockopt(socket_, SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof(limit));  // of connect()
  std::array<char, 4096> ticket;
  ssize_t size = ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  if (size == 0) size = ::recv(socket_, ticket.data(), ticket.size(), 0);
  if (size != ssize_t(kTicketBytes)) {
    const bool is_silent = size < 0 && (errno == EAGAIN || errno == EINPROGRESS);
    const std::string why = is_silent  ? "it gave no answer in time"
                            : size < 0 ? std::strerror(errno)
                                       : "it gave no ticket";
    ::close(socket_);
    refuse(path, why);
  }
  ticket_.assign(ticket.data(), std::size_t(size));
}

LocalChannel::~LocalChannel() { ::close(socket_); }

}  // namespace heliograph::client::wire
