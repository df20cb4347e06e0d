// The second socket by Unix-domain SOCK_SEQPACKET.
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

#include "heliograph/error.h"
#include "wire/lifeline.h"

namespace heliograph::wire {
namespace {

constexpr std::size_t kTicketBytes = 16;

[[noreturn]] void refuse(const std::string& path, const std::string& why) {
  throw ClientError(Code::kUnavailable, "no daemon listens at " + path + ": " + why +
                                            "; start heliographd, or correct the address");
}

}  // namespace

Lifeline::Lifeline(const std::string& path, double seconds) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) refuse(path, "the path is too long for a socket");
  std::memcpy(address.sun_path, path.data(), path.size());
  socket_ = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  timeval limit{};
  limit.tv_sec = time_t(seconds);
  ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof(limit));
  std::array<char, 4096> ticket;
  ssize_t size = ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  if (size == 0) size = ::recv(socket_, ticket.data(), ticket.size(), 0);
  if (size != ssize_t(kTicketBytes)) {
    const std::string why = size < 0 ? std::strerror(errno) : "it gave no ticket";
    ::close(socket_);
    refuse(path, why);
  }
  ticket_.assign(ticket.data(), std::size_t(size));
}

Lifeline::~Lifeline() { ::close(socket_); }

}  // namespace heliograph::wire
