// Readiness of the daemon: a probe renders a pixel regularly, and stalls of the device are
// detected. Used by lifecycle.cpp; read by GetServerInfo.
#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "server/device/engine_slot.h"
#include "server/os/event_loop.h"

namespace heliograph::server {

/// Thread: the loop's; not_ready() and stand_still(): any. The engine is destroyed before it.
class Health {
 public:
  struct Options {
    double lost_seconds = 10;  // a device lost for longer is lost for good
    double hang_seconds = 4;   // without progress for longer: not ready
    double probe_seconds = 5;  // between two probes, while all is well
  };
  /// Called on changes.
  struct Handlers {
    std::function<void(bool)> on_ready;  // one call at a time; thread: the loop's or the watchdog's
    std::function<void()> on_lost;       // the device is lost for good; called once
  };
  Health(EventLoop& loop, const Log& log, Options options);

  /// Starts to probe and observe the engine.
  void start(EngineSlot& slot, Handlers handlers);
  /// Reports that the first pixel was rendered.
  void first_pixel();
  /// Reports the result of the decoder's trial.
  void decoder(const Status& works);
  /// Ends readiness for good.
  void drain();
  /// Reports the stall of a part of the daemon; "": none is stalled. Thread: any.
  void stand_still(std::string fault);
  /// Returns the reason, for people, why the daemon is not ready; "": it is ready.
  [[nodiscard]] std::string not_ready() const;
  [[nodiscard]] bool is_ready() const { return not_ready().empty(); }

 private:
  using Clock = EventLoop::Clock;
  static constexpr const char* kStarts = "it starts: no pixel was rendered or no file decoded yet";
  void tick();
  void probe(Clock::time_point now);
  void on_probe(const Status& status);
  void notice_crowding(const Engine& engine, Clock::time_point now);
  void notice_losses(const Load& load, Clock::time_point now);
  [[nodiscard]] std::string find_fault(const Load& load, Clock::time_point now) const;
  void set(std::string reason);
  void report();

  EventLoop& loop_;
  const Log& log_;
  const Options options_;
  EngineSlot* slot_ = nullptr;
  Handlers handlers_;
  bool is_draining_ = false;
  std::string probe_fault_ = kStarts;
  std::string decoder_fault_ = kStarts;
  std::optional<Clock::time_point> probe_began_;  // while one is in flight
  Clock::time_point probed_;                      // when the last one ended
  std::optional<Clock::time_point> lost_since_;
  u32 losses_ = 0;                            // losses already logged
  u64 made_again_ = 0;                        // Engine::scenes_made_again() at the last warning
  std::optional<Clock::time_point> crowded_;  // time of the last warning
  mutable std::mutex mutex_;
  std::string reason_ = kStarts;  // guarded by mutex_, like the members below
  std::string still_;             // fault that the watchdog reported
  bool was_reported_ = false;     // ready, at the last report
  bool is_reporting_ = false;     // a thread is in report()
};

}  // namespace heliograph::server
