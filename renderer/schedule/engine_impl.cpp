// Turns of the devices, work that goes away and comes back, devices that are lost.
#include "renderer/schedule/engine_impl.h"

#include <algorithm>
#include <chrono>
#include <utility>

namespace heliograph {
namespace {

constexpr double kNewest = 0.1;  // how much a job counts in the mean of their seconds
/// Between two attempts to make a backend in the place of a lost one.
constexpr auto kRemake = std::chrono::milliseconds(500);
/// Interval at which a device's thread looks after jobs that are away, when it has no work.
constexpr auto kIdleCheck = std::chrono::milliseconds(10);
/// Who had a device since then may be back at any moment.
constexpr auto kLately = std::chrono::milliseconds(100);
// Jobs of a session that may be away at once: each may have a film and its planes.
constexpr std::ptrdiff_t kMostAway = 8;

}  // namespace

Engine::Impl::Impl(std::vector<std::unique_ptr<Backend>> backends, const EngineOptions& options)
    : options_(options), denoiser_(options.device.denoiser, options.device.threads) {
  for (auto& backend : backends) devices_.push_back({.backend = std::move(backend)});
  workers_.emplace(
      Workers::Options{.threads = options.device.threads,
                       .credit = options.credit,
                       .turn = options.turn,
                       .is_alone = [this](const Origin& origin) { return is_alone(origin); }});
  for (u32 i = 0; i < devices_.size(); ++i)
    devices_[i].thread = std::thread([this, i] { device_loop(i); });
}

Engine::Impl::~Impl() {
  {
    const std::scoped_lock lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  for (DeviceThread& device : devices_) device.thread.join();
  workers_.reset();
  refuse_all();
}

void Engine::Impl::submit(std::unique_ptr<Work> work) {
  {
    const std::scoped_lock lock(mutex_);
    push(std::move(work));
  }
  changed_.notify_all();
}

void Engine::Impl::invite(const std::shared_ptr<Spread>& spread) {
  bool has_asked = false;
  {
    const std::scoped_lock lock(mutex_);
    for (u32 i = 0; i < devices_.size(); ++i) {
      if (!devices_[i].is_idle || devices_[i].is_lost || !spread->join(i)) continue;
      push(std::make_unique<HelpWork>(spread, i));
      has_asked = true;
    }
  }
  if (has_asked) changed_.notify_all();
}

Load Engine::Impl::load() const {
  const std::scoped_lock lock(mutex_);
  Load load{.jobs = u32(ready_.size() + away_.size()),
            .seconds_a_job = seconds_a_job_,
            .is_lost = std::ranges::all_of(devices_, &DeviceThread::is_lost),
            .losses = losses_,
            .lost_because = lost_because_,
            .needs_new_process = std::ranges::all_of(devices_, &DeviceThread::is_beyond_us)};
  for (const DeviceThread& device : devices_) {
    const auto still = Clock::now() - device.step_began.value_or(Clock::now());
    load.still_seconds = std::max(load.still_seconds, std::chrono::duration<double>(still).count());
  }
  return load;
}

void Engine::Impl::push(std::unique_ptr<Work> work) {
  const Origin origin = work->origin();
  const bool is_short = work->is_short(), is_back = work->begun.has_value();
  Work& pushed = *work;
  const bool is_next = ready_.push(origin, is_short, std::move(work), is_back);
  set_fresh(pushed, is_next && pushed.seconds < options_.little);
  count_waiting();
}

void Engine::Impl::count_waiting() {
  const auto runs = [](const DeviceThread& device) { return device.step_began.has_value(); };
  waiting_.all = u32(ready_.size()) - u32(std::ranges::count_if(devices_, runs));
}

void Engine::Impl::device_loop(u32 index) {
  const DeviceThread& device = devices_[index];
  Others* others = devices_.size() > 1 ? this : nullptr;
  while (const auto turn = next(index)) {
    const auto start = Clock::now();
    const bool is_done = turn->item()->step(
        {*device.backend, denoiser_, options_.slice, waiting_, others, options_.spread_samples});
    const double cost = std::chrono::duration<double>(Clock::now() - start).count();
    const bool is_lost = device.backend->use().is_lost;
    const auto done = account(index, *turn, cost, is_done && !is_lost);
    if (done)
      end(index, *done);
    else if (auto errands = turn->item()->take_errands(); !errands.empty() && !is_lost)
      send_away(index, *turn, std::move(errands));
    if (is_lost) replace_backend(index);
  }
}

/// Tells its result. A film may take long to free, which a worker does.
void Engine::Impl::end(u32 index, Work& work) {
  work.finish();
  const auto& backend = devices_[index].backend;
  if (work.seconds < options_.little || !backend->info().finishes_elsewhere) return;
  const auto nobody = std::make_shared<Workers::Group>([] {});
  workers_->run(nobody, work.origin(), {{.run = [remains = work.take_remains()](const auto&) {}}},
                backend);
}

/// The workers have what it waits for; the device goes on with others.
void Engine::Impl::send_away(u32 index, const Queue::Turn& turn, std::vector<Errand> errands) {
  std::unique_lock lock(mutex_);
  const auto away =
      away_.insert(away_.end(), Away{.backend = devices_[index].backend, .work = ready_.pop(turn)});
  set_fresh(*away->work, false);
  away->errands = std::make_shared<Workers::Group>([this, away] { come_back(away); });
  const auto group = away->errands;
  const Origin origin = away->work->origin();
  count_waiting();
  lock.unlock();
  if (devices_.size() > 1) changed_.notify_all();  // others may have fewer away now
  workers_->run(group, origin, std::move(errands), devices_[index].backend);
}

void Engine::Impl::come_back(std::list<Away>::iterator away) {
  std::shared_ptr<Backend> backend;  // outlives the work
  std::unique_ptr<Work> lost;
  {
    const std::scoped_lock lock(mutex_);
    backend = away->backend;
    away->work->aside_seconds += away->seconds();
    if (away->has_lost_device)
      lost = std::move(away->work);
    else
      push(std::move(away->work));
    away_.erase(away);
  }
  if (lost) lost->refuse(lost_error());
  changed_.notify_all();
}

bool Engine::Impl::is_alone(const Origin& origin) const {
  const std::scoped_lock lock(mutex_);
  return Clock::now() - sessions_.others(origin.session) > kLately &&
         Clock::now() - scenes_at_once_.others(origin.scene) > kLately;
}

/// Work stays on the device that began it, or whose memory it is for. Other work goes to the idle
/// device with the fewest jobs that are away, the first of them: who asks for one thing after the
/// other finds its scene where it was.
bool Engine::Impl::may_take(u32 index, const Work& work) const {
  if (work.runs || work.interrupt().requested()) return false;
  const auto is_of_session = [&](const Away& away) {
    return away.work->origin().session == work.origin().session;
  };
  if (!work.begun && std::ranges::count_if(away_, is_of_session) >= kMostAway) return false;
  if (work.place != kernels::kNone) return work.place == index;
  const auto load = [&](u32 device) {
    const auto is_of_device = [&](const Away& away) { return away.work->place == device; };
    return std::pair(std::ranges::count_if(away_, is_of_device), device);
  };
  for (u32 other = 0; other < devices_.size(); ++other) {
    const DeviceThread& device = devices_[other];
    if (!device.step_began && !device.is_lost && load(other) < load(index)) return false;
  }
  return true;
}

/// Waits for work; nothing when the engine closes. It stays in the queue while it runs.
auto Engine::Impl::next(u32 index) -> std::optional<Queue::Turn> {
  DeviceThread& device = devices_[index];
  for (;;) {
    refuse_interrupted(index);
    std::unique_lock lock(mutex_);
    std::optional<Queue::Turn> turn;
    const auto something = [&] {
      if (!closing_) turn = ready_.next([&](const auto& w) { return may_take(index, *w); });
      return closing_ || turn;
    };
    if (!something()) {
      device.is_idle = true;
      if (away_.empty() && ready_.empty())
        changed_.wait(lock, [&] { return something() || !away_.empty() || !ready_.empty(); });
      else
        changed_.wait_for(lock, kIdleCheck, something);
      device.is_idle = false;
    }
    if (closing_) return {};
    if (!turn) continue;
    Work& work = *turn->item();
    device.step_began = Clock::now();
    set_fresh(work, false);
    if (!work.begun) work.begun = device.step_began;
    work.place = index;
    work.runs = true;
    count_waiting();
    lock.unlock();
    if (devices_.size() > 1) changed_.notify_all();  // it is no longer the first idle one
    return turn;
  }
}

std::unique_ptr<Work> Engine::Impl::account(u32 index, const Queue::Turn& turn, double cost,
                                            bool is_done) {
  const std::scoped_lock lock(mutex_);
  Work& work = *turn.item();
  devices_[index].step_began.reset();
  ready_.charge(turn, cost);
  sessions_.note(work.origin().session, Clock::now());
  if (ready_.size() + away_.size() > 1) scenes_at_once_.note(work.origin().scene, Clock::now());
  work.seconds += cost;
  work.runs = false;
  set_fresh(work, !is_done && work.seconds < options_.little);
  if (!is_done) return nullptr;
  seconds_a_job_ += kNewest * (work.seconds - seconds_a_job_);
  return ready_.pop(turn);
}

void Engine::Impl::refuse_all() {
  std::vector<std::unique_ptr<Work>> left = ready_.take_if([](const auto&) { return true; });
  for (Away& away : away_) left.push_back(std::move(away.work));
  for (auto& work : left)
    work->refuse({.code = Code::kUnavailable, .message = "the renderer is shutting down"});
}

/// Refuses begun work, which has the lost device's memory; the rest, and derived data, starts anew.
void Engine::Impl::replace_backend(u32 index) {
  std::vector<std::unique_ptr<Work>> begun;
  {
    const std::scoped_lock lock(mutex_);
    devices_[index].is_lost = true;
    ++losses_;
    begun = ready_.take_if(
        [&](const auto& work) { return work->begun.has_value() && work->place == index; });
    for (const auto& work : begun) set_fresh(*work, false);
    for (Away& away : away_) away.has_lost_device |= away.work->place == index;
  }
  for (auto& work : begun) work->refuse(lost_error());
  begun.clear();
  devices_[index].backend->abandon();  // others may hold it for a while
  auto backend = remake(index);
  if (!backend) return;
  {
    const std::scoped_lock lock(mutex_);
    devices_[index].backend.swap(backend);
    devices_[index].is_lost = false;
  }
  changed_.notify_all();
}

/// Null when the engine closes.
std::shared_ptr<Backend> Engine::Impl::remake(u32 index) {
  BackendOptions own = options_.device;
  own.index = index;
  own.cache_bytes /= devices_.size();
  for (;;) {
    if (!devices_[index].is_beyond_us) {
      auto made = make_backend(options_.backend, own);
      if (made) return *std::move(made);
      const std::scoped_lock lock(mutex_);
      lost_because_ = made.error().message;
      devices_[index].is_beyond_us = needs_new_process(made.error());
    }
    refuse_interrupted(index);
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, kRemake, [&] { return closing_; })) return nullptr;
  }
}

/// Refuses what is interrupted and waits, but not what other devices began: its memory is theirs.
void Engine::Impl::refuse_interrupted(u32 index) {
  const auto is_interrupted = [&](const auto& work) {
    return work->interrupt().requested() && !work->runs && (!work->begun || work->place == index);
  };
  std::vector<std::unique_ptr<Work>> interrupted;
  std::vector<std::shared_ptr<Workers::Group>> unwanted;
  {
    const std::scoped_lock lock(mutex_);
    interrupted = ready_.take_if(is_interrupted);
    for (const auto& work : interrupted) set_fresh(*work, false);
    for (const Away& away : away_)
      if (away.work->interrupt().requested()) unwanted.push_back(away.errands);
  }
  for (auto& work : interrupted) work->refuse(work->interrupt().status().error());
  for (const auto& errands : unwanted) workers_->abandon(errands);
}

}  // namespace heliograph
