// Descriptors, packets and sealed memfds: how the daemon, the zygote and its children exchange jobs
// and results.
#pragma once

#include <google/protobuf/message_lite.h>

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Owns: a file descriptor.
class Fd {
 public:
  Fd() = default;
  explicit Fd(int fd) : fd_(fd) {}
  Fd(Fd&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Fd& operator=(Fd&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~Fd();
  [[nodiscard]] int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_ = -1;
};

/// The first byte of every packet.
enum class PacketKind : char {
  kHello = 'H',    // zygote to daemon: a Hello message
  kLaunch = 'L',   // daemon to zygote: job socket, job memfd, memfd for the result
  kStarted = 'P',  // zygote, on the job socket: a pidfd of the child
  kResult = 'R',   // child, on the job socket: the result is written
  kExited = 'X',   // zygote, on the job socket: the child's wait status (4 bytes)
};
struct Packet {
  PacketKind kind = PacketKind::kHello;
  std::string bytes;
  std::vector<Fd> fds;
};

/// One SOCK_SEQPACKET datagram. Fails with UNAVAILABLE when the other end is gone.
[[nodiscard]] Status send_packet(int socket, PacketKind kind, std::string_view bytes,
                                 std::span<const int> fds);
/// nullopt at the end of the stream.
[[nodiscard]] Expected<std::optional<Packet>> receive_packet(int socket);

/// A connected pair of SOCK_SEQPACKET sockets, closed on exec.
[[nodiscard]] Expected<std::pair<Fd, Fd>> socket_pair();

using Bytes = std::span<const std::byte>;

/// Where arrays go in a data section: next(0) is 0, then multiples of 64.
[[nodiscard]] constexpr std::uint64_t aligned(std::uint64_t offset) {
  return (offset + 63) / 64 * 64;
}

/// An empty memfd that can be sealed.
[[nodiscard]] Expected<Fd> make_region();
/// Writes a message and arrays, each array at aligned(end of the one before).
[[nodiscard]] Status fill_region(int fd, const google::protobuf::MessageLite& message,
                                 std::span<const Bytes> arrays);
/// From now on nobody can write to it. Fails while anybody maps it writable.
[[nodiscard]] Status seal_region(int fd);
/// All three.
[[nodiscard]] Expected<Fd> write_region(const google::protobuf::MessageLite& message,
                                        std::span<const Bytes> arrays);

/// A mapped region. Owns: the mapping. Immutable: it is mapped only when it is sealed against
/// writing, shrinking and growing.
class Region {
 public:
  /// INVALID_ARGUMENT unless the memfd is sealed, has at most `largest` bytes and holds together.
  [[nodiscard]] static Expected<std::shared_ptr<const Region>> map(int fd, std::uint64_t largest);
  ~Region();
  Region(const Region&) = delete;

  [[nodiscard]] std::uint64_t size() const { return bytes_.size(); }
  [[nodiscard]] Bytes message() const { return bytes_.subspan(8, message_size_); }
  /// Bytes of the data section; nullopt when the range leaves it.
  [[nodiscard]] std::optional<Bytes> data(std::uint64_t offset, std::uint64_t size) const;

 private:
  Region(Bytes bytes, std::uint64_t message_size) : bytes_(bytes), message_size_(message_size) {}
  Bytes bytes_;
  std::uint64_t message_size_;
};

/// "name: Permission denied" from errno.
[[nodiscard]] std::string system_message(const char* what);

}  // namespace heliograph::server
