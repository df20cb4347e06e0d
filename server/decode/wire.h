// Descriptors, packets and sealed memfds: how the daemon and heliograph-decode exchange jobs and
// results. A child inherits all its descriptors; packets carry none.
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

/// First byte of a packet, in order of appearance.
enum class PacketKind : char {
  kHello = 'H',   // child: a Hello message
  kGo = 'L',      // daemon: the job is in its region
  kNeed = 'N',    // child: size of the result in bytes, u64
  kGrant = 'G',   // daemon: allows a result of that size
  kResult = 'R',  // child: the result is written
};
struct Packet {
  PacketKind kind = PacketKind::kHello;
  std::string bytes;
};

/// Sends one packet. UNAVAILABLE when the other end is gone.
[[nodiscard]] Status send_packet(int socket, PacketKind kind, std::string_view bytes = "");
/// Receives one packet; nullopt at the end of the stream.
[[nodiscard]] Expected<std::optional<Packet>> receive_packet(int socket);

/// Makes a connected pair of SOCK_SEQPACKET sockets, closed on exec.
[[nodiscard]] Expected<std::pair<Fd, Fd>> socket_pair();

/// Limit of a result's message, without arrays. In memory a message takes many times its serialised
/// size: an empty string 2 bytes here and 32 or more there.
inline constexpr std::uint64_t kMessageBytes = 64ull << 20;

using Bytes = std::span<const std::byte>;

/// Rounds up to the next offset of an array in the data section, a multiple of 64.
[[nodiscard]] constexpr std::uint64_t aligned(std::uint64_t offset) {
  return (offset + 63) / 64 * 64;
}

/// Makes an empty memfd that can be sealed.
[[nodiscard]] Expected<Fd> make_region();
/// Returns the size of a region with this message and these arrays.
[[nodiscard]] std::uint64_t region_size(const google::protobuf::MessageLite& message,
                                        std::span<const Bytes> arrays);
/// Writes a message and arrays, each array at aligned(end of the previous one).
[[nodiscard]] Status fill_region(int fd, const google::protobuf::MessageLite& message,
                                 std::span<const Bytes> arrays);
/// Seals a region against writing and resizing. Fails while a writable mapping exists.
[[nodiscard]] Status seal_region(int fd);
/// Makes, fills and seals a region.
[[nodiscard]] Expected<Fd> write_region(const google::protobuf::MessageLite& message,
                                        std::span<const Bytes> arrays);

/// A mapped region. Owns: the mapping. Immutable: only regions sealed against writing and resizing
/// are mapped.
class Region {
 public:
  /// Maps a region. INVALID_ARGUMENT unless the memfd is sealed, has at most `largest` bytes and is
  /// consistent.
  [[nodiscard]] static Expected<std::shared_ptr<const Region>> map(int fd, std::uint64_t largest);
  ~Region();
  Region(const Region&) = delete;

  [[nodiscard]] std::uint64_t size() const { return bytes_.size(); }
  [[nodiscard]] Bytes message() const { return bytes_.subspan(8, message_size_); }
  /// Returns a range of the data section; nullopt when it lies outside.
  [[nodiscard]] std::optional<Bytes> data(std::uint64_t offset, std::uint64_t size) const;

 private:
  Region(Bytes bytes, std::uint64_t message_size) : bytes_(bytes), message_size_(message_size) {}
  Bytes bytes_;
  std::uint64_t message_size_;
};

/// Returns "what: Permission denied" for errno.
[[nodiscard]] std::string system_message(const char* what);
/// Its name.
[[nodiscard]] constexpr std::string_view name_of(std::string_view message) {
  return message.substr(0, message.find(':'));
}

}  // namespace heliograph::server
