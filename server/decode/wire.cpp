#include "server/decode/wire.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>

namespace heliograph::server {
namespace {

constexpr std::size_t kLongestPacket = 64 << 10;
constexpr int kSeals = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE;

/// Where the arrays begin, and where they end from there on.
std::pair<std::uint64_t, std::uint64_t> layout(std::uint64_t message_bytes,
                                               std::span<const Bytes> arrays) {
  std::uint64_t end = 0;
  for (const Bytes array : arrays) end = aligned(end) + array.size();
  return {aligned(8 + message_bytes), end};
}

Status write_all(int fd, Bytes bytes, std::uint64_t offset) {
  while (!bytes.empty()) {
    const ssize_t written = pwrite(fd, bytes.data(), bytes.size(), off_t(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return fail(Code::kResourceExhausted, "", system_message("memfd"));
    bytes = bytes.subspan(std::size_t(written));
    offset += std::uint64_t(written);
  }
  return {};
}

}  // namespace

Fd::~Fd() {
  if (fd_ >= 0) close(fd_);
}

std::string system_message(const char* what) {
  const int code = errno;
  std::array<char, 128> text{};
  return std::string(what) + ": " + strerror_r(code, text.data(), text.size());
}

Status send_packet(int socket, PacketKind kind, std::string_view bytes) {
  char first = char(kind);
  iovec parts[] = {{&first, 1}, {const_cast<char*>(bytes.data()), bytes.size()}};
  msghdr message{};
  message.msg_iov = parts;
  message.msg_iovlen = 2;
  ssize_t sent;
  do sent = sendmsg(socket, &message, MSG_NOSIGNAL);
  while (sent < 0 && errno == EINTR);
  if (sent < 0) return fail(Code::kUnavailable, "", system_message("sendmsg"));
  return {};
}

Expected<std::optional<Packet>> receive_packet(int socket) {
  std::string bytes(kLongestPacket, '\0');
  ssize_t received;
  do received = read(socket, bytes.data(), bytes.size());  // the sandbox does not allow recvmsg
  while (received < 0 && errno == EINTR);
  if (received == 0 || (received < 0 && errno == ECONNRESET)) return std::optional<Packet>();
  if (received < 0) return fail(Code::kUnavailable, "", system_message("read"));
  return Packet{.kind = PacketKind(bytes[0]), .bytes = bytes.substr(1, std::size_t(received) - 1)};
}

Expected<std::pair<Fd, Fd>> socket_pair() {
  int fds[2];
  if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, fds) != 0) {
    return fail(Code::kResourceExhausted, "", system_message("socketpair"));
  }
  return std::pair(Fd(fds[0]), Fd(fds[1]));
}

Expected<Fd> make_region() {
  Fd fd(memfd_create("heliograph-decode", MFD_CLOEXEC | MFD_ALLOW_SEALING));
  if (!fd) return fail(Code::kResourceExhausted, "", system_message("memfd_create"));
  return fd;
}

std::uint64_t region_size(const google::protobuf::MessageLite& message,
                          std::span<const Bytes> arrays) {
  const auto [base, end] = layout(message.ByteSizeLong(), arrays);
  return base + end;
}

Status fill_region(int fd, const google::protobuf::MessageLite& message,
                   std::span<const Bytes> arrays) {
  std::string head(8, '\0');
  if (!message.AppendToString(&head)) return fail(Code::kInternal, "", "a message over 2 GiB");
  const std::uint64_t size = head.size() - 8;
  std::memcpy(head.data(), &size, 8);
  const auto [base, bytes] = layout(size, arrays);
  if (ftruncate(fd, off_t(base + bytes)) != 0) {
    return fail(Code::kResourceExhausted, "", system_message("ftruncate"));
  }
  HELIO_TRY(write_all(fd, std::as_bytes(std::span(head)), 0));
  std::uint64_t end = 0;
  for (const Bytes array : arrays) {
    HELIO_TRY(write_all(fd, array, base + aligned(end)));
    end = aligned(end) + array.size();
  }
  return {};
}

Status seal_region(int fd) {
  // EBUSY: after waiting some 100 ms the kernel still uses a page, for example to migrate it.
  for (int i = 0; i < 20; ++i) {
    if (fcntl(fd, F_ADD_SEALS, kSeals | F_SEAL_SEAL) == 0) return {};
    if (errno != EBUSY) break;
  }
  return fail(Code::kInternal, "", system_message("F_ADD_SEALS"));
}

Expected<Fd> write_region(const google::protobuf::MessageLite& message,
                          std::span<const Bytes> arrays) {
  auto fd = make_region();
  if (!fd) return fd;
  HELIO_TRY(fill_region(fd->get(), message, arrays));
  HELIO_TRY(seal_region(fd->get()));
  return fd;
}

Expected<std::shared_ptr<const Region>> Region::map(int fd, std::uint64_t largest) {
  const int seals = fcntl(fd, F_GET_SEALS);
  const off_t end = lseek(fd, 0, SEEK_END);  // not fstat(): its system call takes paths
  if (seals < 0 || (seals & kSeals) != kSeals || end < 0) {
    return fail(Code::kInvalidArgument, "", "the memfd is not sealed");
  }
  const auto size = std::uint64_t(end);
  if (size < 8 || size > largest) {
    return fail(Code::kInvalidArgument, "", "the memfd has an impossible size");
  }
  void* at = mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, 0);
  if (at == MAP_FAILED) return fail(Code::kResourceExhausted, "", system_message("mmap"));
  const Bytes bytes(static_cast<const std::byte*>(at), size);
  std::uint64_t message_size;
  std::memcpy(&message_size, bytes.data(), 8);
  std::shared_ptr<const Region> region(new Region(bytes, message_size));
  if (message_size > size - 8) {
    return fail(Code::kInvalidArgument, "", "the message leaves the memfd");
  }
  return region;
}

Region::~Region() { munmap(const_cast<std::byte*>(bytes_.data()), bytes_.size()); }

std::optional<Bytes> Region::data(std::uint64_t offset, std::uint64_t size) const {
  const std::uint64_t base = aligned(8 + message_size_);
  if (size == 0) return Bytes{};
  if (base > bytes_.size() || offset > bytes_.size() - base ||
      size > bytes_.size() - base - offset) {
    return std::nullopt;
  }
  return bytes_.subspan(base + offset, size);
}

}  // namespace heliograph::server
