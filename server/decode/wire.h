// Descriptors, packets and sealed memfds: how the daemon and heliograph-decode exchange jobs and
// results. A child is born with all its descriptors; packets carry none.
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

/// The descriptors of a child.
inline constexpr int kSocket = 3;        // a SOCK_SEQPACKET socket to the daemon
inline constexpr int kJobRegion = 4;     // a memfd: the daemon fills and seals it before kGo
inline constexpr int kResultRegion = 5;  // a memfd: the child fills it after kGrant

/// The first byte of every packet, in the order in which they come.
enum class PacketKind : char {
  kHello = 'H',   // child: a Hello message
  kGo = 'L',      // daemon: the job lies there
  kNeed = 'N',    // child: bytes of the result (8)
  kGrant = 'G',   // daemon: it may write as many
  kResult = 'R',  // child: the result is written
};
struct Packet {
  PacketKind kind = PacketKind::kHello;
  std::string bytes;
};

/// One SOCK_SEQPACKET datagram. Fails with UNAVAILABLE when the other end is gone.
[[nodiscard]] Status send_packet(int socket, PacketKind kind, std::string_view bytes = "");
/// nullopt at the end of the stream.
[[nodiscard]] Expected<std::optional<Packet>> receive_packet(int socket);

/// A connected pair of SOCK_SEQPACKET sockets, closed on exec.
[[nodiscard]] Expected<std::pair<Fd, Fd>> socket_pair();

/// Of a result, beside its arrays. In memory a message takes many times its bytes here: an empty
/// string 2 of them and 32 or more there.
inline constexpr std::uint64_t kMessageBytes = 64ull << 20;

using Bytes = std::span<const std::byte>;

/// Where arrays go in a data section: next(0) is 0, then multiples of 64.
[[nodiscard]] constexpr std::uint64_t aligned(std::uint64_t offset) {
  return (offset + 63) / 64 * 64;
}

/// An empty memfd that can be sealed.
[[nodiscard]] Expected<Fd> make_region();
/// Bytes of a region with this message and these arrays.
[[nodiscard]] std::uint64_t region_size(const google::protobuf::MessageLite& message,
                                        std::span<const Bytes> arrays);
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
/// Its name.
[[nodiscard]] constexpr std::string_view name_of(std::string_view message) {
  return message.substr(0, message.find(':'));
}

}  // namespace heliograph::server
