// A device with its thread, and a job while it is away from there. Kept by engine_impl.cpp.
#pragma once

#include <thread>

#include "renderer/schedule/work.h"
#include "renderer/schedule/workers.h"

namespace heliograph {

/// A device and the thread that owns it.
struct DeviceThread {
  std::shared_ptr<Backend> backend;  // replaced by the thread
  std::optional<Work::Clock::time_point> step_began{};
  bool is_idle = false;
  bool is_lost = false;
  bool is_beyond_us = false;  // lost, and not to be had again in this process
  std::thread thread{};
};

/// Times when devices last had work, and of whom.
class LastServed {
 public:
  void note(u64 who, Work::Clock::time_point now) {
    if (who != who_) others_ = at_;
    who_ = who;
    at_ = now;
  }
  /// The last time that it was of another.
  [[nodiscard]] Work::Clock::time_point others(u64 who) const {
    return who == who_ ? others_ : at_;
  }

 private:
  u64 who_ = 0;
  Work::Clock::time_point at_{}, others_{};
};

/// A job whose errands are done by others.
struct Away {
  std::shared_ptr<Backend> backend;  // of the device, which may be replaced meanwhile
  std::unique_ptr<Work> work;
  std::shared_ptr<Workers::Group> errands{};
  Work::Clock::time_point left = Work::Clock::now();
  bool has_lost_device = false;

  [[nodiscard]] double seconds() const {
    return std::chrono::duration<double>(Work::Clock::now() - left).count();
  }
};

/// Error of work that had begun on a device that was lost.
[[nodiscard]] inline Error lost_error() {
  return {.code = Code::kUnavailable,
          .message = "the device was lost while it rendered this, and is started again; ask again",
          .where = "",
          .retry_seconds = 1};
}

}  // namespace heliograph
