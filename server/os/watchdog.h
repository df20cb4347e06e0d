// A thread that sees whether what nothing may stop moves: the event loop, the threads of calls, the
// work pool, the log. Started by lifecycle.cpp.
#pragma once

#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "server/os/event_loop.h"
#include "server/os/log.h"

namespace heliograph::server {

/// Owns: its thread, which waits for nothing that it looks at. Thread: any.
class Watchdog {
 public:
  struct Options {
    double hang_seconds = 4;    // a part that stands still for so long is a fault
    double stuck_seconds = 60;  // a vital part does not come back: the daemon is not live
  };
  /// How much hangs on a part.
  enum class Needs { kNothing, kLiveness, kReadiness };
  struct Part {
    std::string name;
    Needs needs = Needs::kNothing;  // readiness includes liveness
    std::function<double()> still_seconds;
  };
  /// What follows; from the watchdog's thread.
  struct Told {
    std::function<void(const std::string& fault)> ready;    // when it changes; "": all moves
    std::function<void(bool is_live)> live;                 // when it changes
    std::function<void(double loop_still_seconds)> looked;  // each time
  };
  Watchdog(EventLoop& loop, const Log& log, Options options);
  ~Watchdog() { stop(); }

  /// Looks at these and at the loop from now on, four times a second. Once.
  void start(std::vector<Part> parts, Told told);
  /// No other look begins.
  void stop();
  /// How long each part stood still when it was looked at last, by name.
  [[nodiscard]] std::map<std::string, double> still_seconds() const;

 private:
  using Clock = EventLoop::Clock;
  [[nodiscard]] double ask_loop();
  void work();
  void look();

  EventLoop& loop_;
  const Log& log_;
  const Options options_;
  std::vector<Part> parts_;
  Told told_;
  std::map<std::string, bool> faults_;  // whether a part was told to stand still
  std::string fault_;
  bool is_live_ = true;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool is_stopped_ = false;
  std::map<std::string, double> seen_;
  /// The loop answers by it; it may outlive the watchdog.
  struct Beat {
    std::mutex mutex;
    bool is_asked = false;
    Clock::time_point asked;
  };
  const std::shared_ptr<Beat> beat_ = std::make_shared<Beat>();
  std::thread thread_;
};

}  // namespace heliograph::server
