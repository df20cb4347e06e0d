// Probe and stall detection. See health.h.
#include "server/device/health.h"

namespace heliograph::server {
namespace {

constexpr auto kTick = std::chrono::milliseconds(250);
constexpr auto kWarnAgain = std::chrono::minutes(1);
constexpr double kRetry = 0.5;  // seconds between probes while something is wrong

double seconds(EventLoop::Clock::duration duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

Health::Health(EventLoop& loop, const Log& log, Options options)
    : loop_(loop), log_(log), options_(options) {}

void Health::start(EngineSlot& slot, Handlers handlers) {
  slot_ = &slot;
  handlers_ = std::move(handlers);
  loop_.after(kTick, [this] { tick(); });
}

void Health::first_pixel() { on_probe({}); }

void Health::decoder(const Status& works) {
  decoder_fault_ = works ? "" : works.error().message;
  const Engine* engine = slot_->get();
  if (engine != nullptr && !is_draining_) set(find_fault(engine->load(), Clock::now()));
}

void Health::drain() {
  is_draining_ = true;
  set("it drains");
}

std::string Health::not_ready() const {
  const std::lock_guard lock(mutex_);
  return still_.empty() ? reason_ : still_;
}

void Health::stand_still(std::string fault) {
  {
    const std::lock_guard lock(mutex_);
    still_ = std::move(fault);
  }
  report();
}

/// Reports a change of readiness. One thread reports at a time, until the reported state is the
/// latest; a concurrent caller leaves it to that thread.
void Health::report() {
  std::unique_lock lock(mutex_);
  if (is_reporting_) return;
  is_reporting_ = true;
  while (true) {
    const bool is_now = reason_.empty() && still_.empty();
    if (std::exchange(was_reported_, is_now) == is_now) break;
    lock.unlock();
    handlers_.on_ready(is_now);
    lock.lock();
  }
  is_reporting_ = false;
}

void Health::tick() {
  const auto now = Clock::now();
  const Engine* engine = slot_->get();
  if (engine != nullptr && !is_draining_) {
    const Load load = engine->load();
    notice_losses(load, now);
    notice_crowding(*engine, now);
    set(find_fault(load, now));
    if (load.needs_new_process) return handlers_.on_lost();
    if (lost_since_ && seconds(now - *lost_since_) > options_.lost_seconds)
      return handlers_.on_lost();
    const double wait = probe_fault_.empty() ? options_.probe_seconds : kRetry;
    const bool has_begun = probed_ != Clock::time_point{};  // the first probe is EngineSlot's
    if (has_begun && !probe_began_ && seconds(now - probed_) > wait) probe(now);
  }
  report();
  loop_.after(kTick, [this] { tick(); });
}

/// Warns when scenes evict each other from the derived data: they render slowly, and nothing else
/// shows why.
void Health::notice_crowding(const Engine& engine, Clock::time_point now) {
  const u64 made_again = engine.scenes_made_again();
  if (made_again == made_again_ || (crowded_ && now - *crowded_ < kWarnAgain)) return;
  log_.warning(
      "scenes take turns in the memory of derived data, and are made again each time; "
      "raise --limit derived_bytes, or render each for longer before the next",
      {{"made_again", made_again - made_again_}, {"bytes", engine.derived_bytes()}});
  made_again_ = made_again;
  crowded_ = now;
}

/// Records a lost device. Its replacement has to render a pixel first.
void Health::notice_losses(const Load& load, Clock::time_point now) {
  if (!load.is_lost)
    lost_since_.reset();
  else if (!lost_since_)
    lost_since_ = now;
  if (load.losses == losses_) return;
  losses_ = load.losses;
  log_.error("the device was lost", {{"losses", losses_}});
  probe_fault_ = "the device was lost, and the new one has rendered no pixel yet";
}

/// Returns the present fault; the device's own state first, as it is known before a probe ends.
std::string Health::find_fault(const Load& load, Clock::time_point now) const {
  if (load.is_lost)
    return (load.needs_new_process ? "the device was lost and needs a new process"
                                   : "the device was lost and is started again") +
           (load.lost_because.empty() ? "" : "; the last attempt: " + load.lost_because);
  if (load.still_seconds > options_.hang_seconds)
    return fmt::format("nothing moved on the device for {:.0f} s", options_.hang_seconds);
  if (probe_began_ && seconds(now - *probe_began_) > options_.hang_seconds)
    return fmt::format("a pixel took more than {:.0f} s", options_.hang_seconds);
  return probe_fault_.empty() ? decoder_fault_ : probe_fault_;
}

void Health::probe(Clock::time_point now) {
  probe_began_ = now;
  slot_->probe([this](const Status& status) { loop_.post([this, status] { on_probe(status); }); });
}

void Health::on_probe(const Status& status) {
  probed_ = Clock::now();
  probe_began_.reset();
  probe_fault_ = status ? "" : "no pixel could be rendered: " + status.error().message;
  if (!is_draining_) set(find_fault(slot_->get()->load(), probed_));
}

void Health::set(std::string reason) {
  {
    const std::lock_guard lock(mutex_);
    if (reason == reason_) return;
    reason_ = reason;
  }
  if (reason.empty())
    log_.info("ready");
  else if (is_draining_)
    log_.info("not ready", {{"reason", reason}});
  else
    log_.warning("not ready", {{"reason", reason}});
  report();
}

}  // namespace heliograph::server
