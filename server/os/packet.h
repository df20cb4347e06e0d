// One packet of a SOCK_SEQPACKET socket, with a descriptor. Used by the second socket and by quick
// calls.
#pragma once

#include <sys/socket.h>

#include <array>
#include <cstring>
#include <span>

namespace heliograph::server {

/// Sends the pieces as one packet, with a descriptor unless that is -1. False when the socket does
/// not take it at once: its client has left, or reads nothing.
[[nodiscard]] inline bool send_packet(int socket, std::span<iovec> pieces, int descriptor) {
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof descriptor)> control{};
  msghdr message{};
  message.msg_iov = pieces.data();
  message.msg_iovlen = pieces.size();
  if (descriptor >= 0) {
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    cmsghdr* header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(sizeof descriptor);
    std::memcpy(CMSG_DATA(header), &descriptor, sizeof descriptor);
  }
  std::size_t size = 0;
  for (const iovec& piece : pieces) size += piece.iov_len;
  return ::sendmsg(socket, &message, MSG_DONTWAIT | MSG_NOSIGNAL) == ssize_t(size);
}

}  // namespace heliograph::server
