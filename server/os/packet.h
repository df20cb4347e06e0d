// One packet of a SOCK_SEQPACKET socket, with descriptors. Used by the local channel and by quick
// calls.
#pragma once

#include <sys/socket.h>

#include <array>
#include <cstring>
#include <span>
#include <vector>

#include "server/os/closer.h"

namespace heliograph::server {

/// Sends the pieces as one packet, with a descriptor unless that is -1. Never blocks. False when
/// the socket does not accept it: its client has left, or does not read.
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

struct ReceivedPacket {
  ssize_t size = -1;  // of the whole packet, which may exceed `data`; else recvmsg()'s result
  std::vector<ForeignFd> descriptors;
};

/// Receives one packet with all of its descriptors, whose sender is the socket's. There is room for
/// as many as the kernel allows: it would close the excess within recvmsg(), which may take long.
[[nodiscard]] inline ReceivedPacket receive_packet(const ForeignFd& socket, std::span<char> data,
                                                   int flags, Closer& closer) {
  constexpr std::size_t kMost = 253;  // SCM_MAX_FD
  alignas(cmsghdr) std::array<char, CMSG_SPACE(kMost * sizeof(int))> control;
  iovec piece{data.data(), data.size()};
  msghdr message{};
  message.msg_iov = &piece;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  ReceivedPacket packet;
  packet.size = ::recvmsg(socket.get(), &message, flags | MSG_TRUNC | MSG_CMSG_CLOEXEC);
  if (packet.size < 0) return packet;
  for (cmsghdr* each = CMSG_FIRSTHDR(&message); each; each = CMSG_NXTHDR(&message, each)) {
    if (each->cmsg_level != SOL_SOCKET || each->cmsg_type != SCM_RIGHTS) continue;
    for (std::size_t i = 0; CMSG_LEN((i + 1) * sizeof(int)) <= each->cmsg_len; ++i) {
      int fd = -1;
      std::memcpy(&fd, CMSG_DATA(each) + i * sizeof fd, sizeof fd);
      packet.descriptors.emplace_back(closer, UniqueFd(fd), socket.sender());
    }
  }
  return packet;
}

}  // namespace heliograph::server
