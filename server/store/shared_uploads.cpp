// Checking, taking and consuming buffers. Called by the local channel and SessionArrays.
#include "server/store/shared_uploads.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

namespace heliograph::server {
namespace {

constexpr std::size_t kMost = 16'384;   // unused buffers of a session; further ones are dropped
constexpr u64 kFewestMapped = 1 << 20;  // bytes; smaller buffers are copied: mappings are few
constexpr u64 kAlignment = 64;

bool is_sealed(int fd) {
  constexpr int kNeeded = F_SEAL_WRITE | F_SEAL_SHRINK | F_SEAL_GROW;
  const int seals = ::fcntl(fd, F_GET_SEALS);
  return seals >= 0 && (seals & kNeeded) == kNeeded;
}

}  // namespace

struct SharedUploads::Memory {
  explicit Memory(Charge room) : charge(std::move(room)) {}
  Memory(const Memory&) = delete;
  Memory& operator=(const Memory&) = delete;
  ~Memory() {
    if (!copy && !bytes.empty()) ::munmap(const_cast<std::byte*>(bytes.data()), bytes.size());
  }
  /// False when the kernel refuses.
  [[nodiscard]] bool fill(int fd, u64 size) {
    if (size < kFewestMapped) {
      copy = std::make_unique_for_overwrite<std::byte[]>(size);
      bytes = {copy.get(), size};
      return ::pread(fd, copy.get(), size, 0) == ssize_t(size);
    }
    void* start = ::mmap(nullptr, size, PROT_READ, MAP_SHARED, fd, 0);
    if (start == MAP_FAILED) return false;
    bytes = {static_cast<const std::byte*>(start), size};
    return true;
  }
  Charge charge;
  std::unique_ptr<std::byte[]> copy;  // null: mapped
  std::span<const std::byte> bytes;
};

SharedUploads::Taken SharedUploads::read(u64 bytes, int fd) const {
  struct stat file{};  // after the seals: fstat() of a file that is no memfd may block
  if (!is_sealed(fd) || ::fstat(fd, &file) != 0)
    return fail(Code::kInvalidArgument, "buffer.buffer",
                "is no memfd sealed with F_SEAL_WRITE, F_SEAL_SHRINK and F_SEAL_GROW");
  if (bytes == 0 || u64(file.st_size) != bytes)
    return fail(Code::kInvalidArgument, "buffer.buffer",
                fmt::format("was announced with {} bytes and has {}", bytes, file.st_size));
  HELIO_TRY(budget_->admit(Work::kUploads, bytes));
  auto charge = Charge::take(budget_, bytes);
  if (!charge) return std::unexpected(std::move(charge).error());
  auto memory = std::make_shared<Memory>(std::move(*charge));
  if (!memory->fill(fd, bytes))
    return fail(Code::kResourceExhausted, "buffer.buffer",
                fmt::format("{} bytes could not be mapped; upload the array", bytes));
  return memory;
}

bool SharedUploads::take(u64 buffer, u64 bytes, int fd) {
  auto taken = std::make_shared<const Taken>(read(bytes, fd));
  const std::lock_guard lock(mutex_);
  const bool is_good = bool(*taken) && taken_.size() < kMost;
  if (taken_.size() < kMost) taken_.emplace(buffer, std::move(taken));
  return is_good;
}

std::shared_ptr<const SharedUploads::Taken> SharedUploads::extract(u64 buffer) {
  const std::lock_guard lock(mutex_);
  auto node = taken_.extract(buffer);
  return node ? std::move(node.mapped()) : nullptr;
}

Expected<bool> SharedUploads::read_lent(const v1::BufferRef& ref, const TakePiece& take) const {
  if (ref.generation() == 0 || !lender_.read) return false;
  HELIO_TRY(lender_.read(ref, take));
  return true;
}

Expected<BufferPtr> SharedUploads::take_lent(const v1::BufferRef& ref, Numbers kind) const {
  if (ref.generation() == 0 || !lender_.take) return nullptr;
  return lender_.take(ref, kind);
}

Expected<BufferPtr> SharedUploads::use(const v1::BufferRef& ref) {
  if (ref.generation() != 0 && lender_.copy) return lender_.copy(ref);
  auto taken = extract(ref.buffer());
  if (!taken && poll_) {
    poll_();
    taken = extract(ref.buffer());
  }
  if (!taken)
    return fail(Code::kNotFound, "buffer.buffer",
                fmt::format("this session has no buffer {}; hand it over on the local channel "
                            "again: a use consumes it",
                            ref.buffer()));
  if (!*taken) return std::unexpected(taken->error());
  const auto bytes = (**taken)->bytes;
  if (ref.generation() != 0)
    return fail(Code::kInvalidArgument, "buffer.generation",
                "is of buffers that are lent; leave it out");
  if (ref.offset() % kAlignment != 0)
    return fail(Code::kInvalidArgument, "buffer.offset",
                fmt::format("is {}; it must be a multiple of {}", ref.offset(), kAlignment));
  if (ref.offset() > bytes.size() || ref.size() > bytes.size() - ref.offset())
    return fail(Code::kInvalidArgument, "buffer.size",
                fmt::format("{} bytes from {} do not lie within the buffer's {}", ref.size(),
                            ref.offset(), bytes.size()));
  return std::make_shared<const Buffer>(**taken, bytes.subspan(ref.offset(), ref.size()));
}

}  // namespace heliograph::server
