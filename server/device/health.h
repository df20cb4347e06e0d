// Whether the daemon is ready for work: a probe renders a pixel regularly, and a watchdog sees
// whether the device moves. Used by lifecycle.cpp; asked by GetServerInfo.
#pragma once

#include <mutex>
#include <optional>
#include <string>

#include "server/device/engine_slot.h"
#include "server/os/event_loop.h"

namespace heliograph::server {

/// Thread: the loop's, but for not_ready() and stand_still(). The engine is destroyed before it.
class Health {
 public:
  struct Options {
    double lost_seconds = 10;  // a device was away for this long: it is lost for good
    double hang_seconds = 4;   // nothing moved for this long: not ready
    double probe_seconds = 5;  // between two probes, while all is well
  };
  /// What follows from a change.
  struct Told {
    std::function<void(bool)> ready;  // by one thread at a time, the loop's or the watchdog's
    std::function<void()> lost;       // the device does not come back; once
  };
  Health(EventLoop& loop, const Log& log, Options options);

  /// Looks after the engine from now on.
  void start(EngineSlot& slot, Told told);
  /// The first pixel is there.
  void first_pixel();
  /// Whether files can be decoded.
  void decoder(const Status& works);
  /// Not ready from now on, for good.
  void drain();
  /// A part of the daemon stands still; "": all move. Thread: any.
  void stand_still(std::string fault);
  /// Why it is not ready, for people; "" when it is.
  [[nodiscard]] std::string not_ready() const;
  [[nodiscard]] bool is_ready() const { return not_ready().empty(); }

 private:
  using Clock = EventLoop::Clock;
  static constexpr const char* kStarts = "it starts: no pixel was rendered or no file decoded yet";
  void look();
  void probe(Clock::time_point now);
  void on_probe(const Status& status);
  void notice_crowding(const Engine& engine, Clock::time_point now);
  void notice_losses(const Load& load, Clock::time_point now);
  [[nodiscard]] std::string find_fault(const Load& load, Clock::time_point now) const;
  void set(std::string reason);
  void tell();

  EventLoop& loop_;
  const Log& log_;
  const Options options_;
  EngineSlot* slot_ = nullptr;
  Told told_;
  bool is_draining_ = false;
  std::string probe_fault_ = kStarts;
  std::string decoder_fault_ = kStarts;
  std::optional<Clock::time_point> probe_began_;  // while one is in flight
  Clock::time_point probed_;                      // when the last one ended
  std::optional<Clock::time_point> lost_since_;
  u32 losses_ = 0;                            // that were noticed
  u64 made_again_ = 0;                        // Engine::scenes_made_again() when it was told
  std::optional<Clock::time_point> crowded_;  // when it was
  mutable std::mutex mutex_;
  std::string reason_ = kStarts;  // guarded by mutex_, as what is below
  std::string still_;             // what the watchdog says
  bool was_told_ = false;         // to be ready
  bool is_telling_ = false;       // somebody calls told_.ready()
};

}  // namespace heliograph::server
