// A clock that jumps, preloaded into a daemon by tests/fault/clock_skew.py: what reads the wall
// clock sees it off by as many seconds as the file $SKEWED_CLOCK has as an i64. The steady clock
// stays.
//
// A wait until a time of the wall clock is handed on as the time that the machine's clock will show
// then, as far as it goes through futex(2).
#include <fcntl.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <cstdint>
#include <cstdlib>
#include <ctime>

namespace {

long call(long number, const long (&a)[6]) {
  long result;
  register long r10 asm("r10") = a[3];
  register long r8 asm("r8") = a[4];
  register long r9 asm("r9") = a[5];
  asm volatile("syscall"
               : "=a"(result)
               : "a"(number), "D"(a[0]), "S"(a[1]), "d"(a[2]), "r"(r10), "r"(r8), "r"(r9)
               : "rcx", "r11", "memory");
  return result;
}

std::int64_t offset() {
  static const volatile std::int64_t* const seconds = [] {
    const char* path = std::getenv("SKEWED_CLOCK");
    const int fd = path == nullptr ? -1 : ::open(path, O_RDONLY | O_CLOEXEC);
    void* page = ::mmap(nullptr, sizeof(std::int64_t), PROT_READ, MAP_SHARED, fd, 0);
    return page == MAP_FAILED ? nullptr : static_cast<const volatile std::int64_t*>(page);
  }();
  return seconds == nullptr ? 0 : *seconds;
}

bool is_wall(clockid_t clock) { return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE; }

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* out) noexcept {
  if (call(SYS_clock_gettime, {clock, reinterpret_cast<long>(out), 0, 0, 0, 0}) != 0) return -1;
  if (is_wall(clock)) out->tv_sec += offset();
  return 0;
}

int gettimeofday(timeval* out, void*) noexcept {
  timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  *out = {now.tv_sec, now.tv_nsec / 1000};
  return 0;
}

time_t time(time_t* out) noexcept {
  timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (out != nullptr) *out = now.tv_sec;
  return now.tv_sec;
}

long syscall(long number, ...) noexcept {
  long a[6];
  va_list list;
  va_start(list, number);
  for (long& value : a) value = va_arg(list, long);
  va_end(list);
  timespec until;
  const auto* given = reinterpret_cast<const timespec*>(a[3]);
  if (number == SYS_futex && (a[1] & FUTEX_CLOCK_REALTIME) != 0 && given != nullptr) {
    until = {given->tv_sec - offset(), given->tv_nsec};
    a[3] = reinterpret_cast<long>(&until);
  }
  const long result = call(number, a);
  if (result >= 0 || result < -4095) return result;
  errno = int(-result);
  return -1;
}

}  // extern "C"
