// See disk_room.h.
#include "server/journal/disk_room.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>

#include "server/os/unique_fd.h"

namespace heliograph::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr u64 kLookBytes = 64 << 10;  // written before free space is measured again
constexpr auto kLookAfter = std::chrono::milliseconds(100);
constexpr u64 kCopies = 2;      // of an edit: in the log, and in the file after a checkpoint
constexpr u64 kLittle = 4;      // "little" is 1 / kLittle of the spare room
constexpr u64 kReserveOf = 16;  // parts of the disk
constexpr u64 kSpareOf = 8;
constexpr double kRetrySeconds = 1;

std::unexpected<Error> too_little(u64 needed, u64 available) {
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("the disk of the state directory has {} bytes left for this, "
                                     "which needs {}; delete durable scenes, or make room (what "
                                     "is left to others: limit disk_spare_bytes)",
                                     available, needed),
              .where = ""};
  error.limit = "disk_spare_bytes";
  error.needed = needed;
  error.available = available;
  error.retry_seconds = kRetrySeconds;
  return std::unexpected(std::move(error));
}

}  // namespace

DiskRoom::DiskRoom(Options options) : options_(std::move(options)) {
  struct statvfs disk{};
  const bool is_known = ::statvfs(options_.folder.c_str(), &disk) == 0;
  size_ = is_known ? u64(disk.f_blocks) * disk.f_frsize : ~u64(0);
  reserve_ = std::min(options_.reserve, size_ / kReserveOf);
  spare_ = std::min(options_.spare, size_ / kSpareOf);
}

u64 DiskRoom::left() {
  struct statvfs disk{};
  const auto now = Clock::now();
  if (written_ > kLookBytes || now - looked_ > kLookAfter) {
    const bool is_known = ::statvfs(options_.folder.c_str(), &disk) == 0;
    free_ = is_known ? u64(disk.f_bavail) * disk.f_frsize : ~u64(0);
    written_ = 0;
    looked_ = now;
  }
  return free_ - std::min(free_, written_);
}

Status DiskRoom::admit(u64 bytes, u64 used) {
  const bool has_much = used + bytes > spare_ / kLittle;
  // When even small writes find no room, the database fails, and all waiting edits with it.
  const bool is_small = bytes < kLookBytes;
  if (is_small && !has_much) return {};
  Status admitted = admit_beside(kCopies * bytes, has_much ? spare_ + snapshot_ : 0);
  if (admitted || !is_small) return admitted;
  const std::lock_guard lock(mutex_);
  return left() < kLookBytes ? Status() : admitted;
}

Status DiskRoom::admit_snapshot(u64 bytes) {
  return admit_beside(bytes, bytes > spare_ / kLittle ? spare_ : 0);
}

Status DiskRoom::admit_beside(u64 needed, u64 kept) {
  const std::lock_guard lock(mutex_);
  u64 left_now = left();
  if (needed + kept > left_now) {
    looked_ = {};
    left_now = left();
  }
  const u64 available = left_now - std::min(left_now, kept);
  if (needed > available) return too_little(needed, available);
  written_ += needed;
  return {};
}

Status DiskRoom::take_reserve() {
  const std::lock_guard lock(mutex_);
  looked_ = {};
  const u64 needed = reserve_ + reserve_ / 4, available = left();
  if (needed > available) return too_little(needed, available);
  const std::string path = options_.folder + "/reserve";
  const UniqueFd file(::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  if (file && ::posix_fallocate(file.get(), 0, off_t(reserve_)) == 0) return {};
  ::unlink(path.c_str());
  return too_little(needed, available);
}

void DiskRoom::release_reserve() {
  const std::lock_guard lock(mutex_);
  ::unlink((options_.folder + "/reserve").c_str());
  looked_ = {};
}

}  // namespace heliograph::server
