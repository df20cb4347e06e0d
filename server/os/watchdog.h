// A thread that detects stalls of the event loop, the threads of calls, the work pool and the log.
// Started by lifecycle.cpp.
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

/// Owns: its thread, which never waits for the parts that it checks. Thread: any.
class Watchdog {
 public:
  struct Options {
    double hang_seconds = 4;    // a part stalled for longer is a fault
    double stuck_seconds = 60;  // a part that liveness needs, stalled for longer: not live
  };
  /// Kinds of health that a stall of a part takes away.
  enum class Needs { kNothing, kLiveness, kReadiness };
  struct Part {
    std::string name;
    Needs needs = Needs::kNothing;  // readiness includes liveness
    std::function<double()> still_seconds;
  };
  /// Called on changes. Thread: the watchdog's.
  struct Handlers {
    std::function<void(const std::string& fault)> on_fault;  // when it changes; "": no stall
    std::function<void(bool is_live)> on_live;               // when it changes
    std::function<void(double loop_still_seconds)> on_tick;  // on every tick, 4 per second
  };
  Watchdog(EventLoop& loop, const Log& log, Options options);
  ~Watchdog() { stop(); }

  /// Starts the thread, which checks these parts and the loop four times per second. Called once.
  void start(std::vector<Part> parts, Handlers handlers);
  /// Ends the thread.
  void stop();
  /// Returns how long each part was stalled at the last tick, in seconds, by name.
  [[nodiscard]] std::map<std::string, double> still_seconds() const;

 private:
  using Clock = EventLoop::Clock;
  [[nodiscard]] double ask_loop();
  void work();
  void tick();

  EventLoop& loop_;
  const Log& log_;
  const Options options_;
  std::vector<Part> parts_;
  Handlers handlers_;
  std::map<std::string, bool> faults_;  // by part: its stall was logged
  std::string fault_;
  bool is_live_ = true;
  mutable std::mutex mutex_;
  std::condition_variable wake_;
  bool is_stopped_ = false;
  std::map<std::string, double> seen_;
  /// Round trip to the loop; may outlive the watchdog.
  struct Beat {
    std::mutex mutex;
    bool is_asked = false;
    Clock::time_point asked;
  };
  const std::shared_ptr<Beat> beat_ = std::make_shared<Beat>();
  std::thread thread_;
};

}  // namespace heliograph::server
