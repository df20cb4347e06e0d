// See overload.h.
#include "server/quota/overload.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>

namespace heliograph::server {
namespace {

constexpr i64 kFreshMilliseconds = 20;  // age up to which a measurement is reused

i64 now_milliseconds() {
  using std::chrono::steady_clock;
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

u64 resident_bytes() {
  static const u64 page = u64(::sysconf(_SC_PAGESIZE));
  std::ifstream file("/proc/self/statm");  // pages: all, resident, ...
  u64 all = 0, resident = 0;
  file >> all >> resident;
  return resident * page;
}

const char* name_of(Work work) {
  switch (work) {
    case Work::kSessions:
      return "new sessions";
    case Work::kUploads:
      return "uploads";
    case Work::kJobs:
      break;
  }
  return "jobs";
}

u64 Overload::allowed(Work work, u64 total) const {
  const u64 percent = options_.percent[std::size_t(work)];
  return total / 100 * percent + total % 100 * percent / 100;
}

bool Overload::is_full(Work work, u64 used, u64 total) const { return used > allowed(work, total); }

u64 Overload::resident() const {
  const i64 now = now_milliseconds();
  i64 before = read_at_;
  if (now - before >= kFreshMilliseconds && read_at_.compare_exchange_strong(before, now))
    resident_ = options_.resident();
  return resident_;
}

Status Overload::check_memory(Work work, u64 bytes) const {
  if (options_.memory_bytes == 0) return {};
  const u64 used = resident(), most = allowed(work, options_.memory_bytes);
  const u64 room = most - std::min(used, most);
  if (used <= most && bytes <= room) return {};
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format(
                  "the daemon's memory is too full for {}: {} bytes of {} are in use, {} more are "
                  "needed, and {} is where {} end; remove what is not used any more, or give it "
                  "more memory (limit memory_bytes)",
                  name_of(work), used, options_.memory_bytes, bytes, most, name_of(work)),
              .where = ""};
  error.limit = "memory_bytes";
  error.needed = std::max<u64>(bytes, 1);
  error.available = room;
  error.allowed = most;
  if (bytes <= most) error.retry_seconds = kFullSeconds;
  return std::unexpected(std::move(error));
}

}  // namespace heliograph::server
