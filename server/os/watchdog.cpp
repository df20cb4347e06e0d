// See watchdog.h.
#include "server/os/watchdog.h"

#include <algorithm>

namespace heliograph::server {
namespace {

constexpr auto kTick = std::chrono::milliseconds(250);

double seconds_since(EventLoop::Clock::time_point start) {
  return std::chrono::duration<double>(EventLoop::Clock::now() - start).count();
}

}  // namespace

Watchdog::Watchdog(EventLoop& loop, const Log& log, Options options)
    : loop_(loop), log_(log), options_(options) {}

void Watchdog::start(std::vector<Part> parts, Handlers handlers) {
  parts_ = std::move(parts);
  parts_.push_back({"loop", Needs::kReadiness, [this] { return ask_loop(); }});
  handlers_ = std::move(handlers);
  thread_ = std::thread([this] { work(); });
}

void Watchdog::stop() {
  {
    const std::lock_guard lock(mutex_);
    is_stopped_ = true;
  }
  wake_.notify_all();
  if (thread_.joinable()) thread_.join();
}

std::map<std::string, double> Watchdog::still_seconds() const {
  const std::lock_guard lock(mutex_);
  return seen_;
}

/// Returns how long the loop has not answered, in seconds.
double Watchdog::ask_loop() {
  {
    const std::lock_guard lock(beat_->mutex);
    if (beat_->is_asked) return seconds_since(beat_->asked);
    beat_->is_asked = true;
    beat_->asked = Clock::now();
  }
  loop_.post([beat = beat_] {
    const std::lock_guard lock(beat->mutex);
    beat->is_asked = false;
  });
  return 0;
}

void Watchdog::work() {
  std::unique_lock lock(mutex_);
  while (!wake_.wait_for(lock, kTick, [this] { return is_stopped_; })) {
    lock.unlock();
    tick();
    lock.lock();
  }
}

void Watchdog::tick() {
  std::map<std::string, double> seen;
  std::string fault;
  bool is_live = true;
  for (const Part& part : parts_) {
    const double still = seen[part.name] = part.still_seconds();
    const bool is_still = still > options_.hang_seconds;
    if (is_still && !faults_[part.name])
      log_.error("it stands still", {{"part", part.name}, {"seconds", still}});
    else if (!is_still && faults_[part.name])
      log_.warning("it moves again", {{"part", part.name}});
    faults_[part.name] = is_still;
    if (is_still && part.needs == Needs::kReadiness)
      fault = fmt::format("nothing moved in the daemon for {:.0f} s: {}", options_.hang_seconds,
                          part.name);
    if (still > options_.stuck_seconds && part.needs != Needs::kNothing) is_live = false;
  }
  const double loop_still = seen.at("loop");
  {
    const std::lock_guard lock(mutex_);
    seen_ = std::move(seen);
  }
  if (std::exchange(fault_, fault) != fault) handlers_.on_fault(fault);
  if (std::exchange(is_live_, is_live) != is_live) handlers_.on_live(is_live);
  handlers_.on_tick(loop_still);
}

}  // namespace heliograph::server
