// The queue of jobs, the devices' threads, and jobs that are away from them.
#include "renderer/schedule/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <list>
#include <mutex>
#include <numeric>
#include <optional>
#include <thread>

#include "renderer/frame/check.h"
#include "renderer/schedule/away.h"

namespace heliograph {
namespace {

using Clock = Work::Clock;

constexpr double kNewest = 0.1;  // how much a job counts in the mean of their seconds
/// Between two attempts to make a backend in the place of a lost one.
constexpr auto kRemake = std::chrono::milliseconds(500);
/// How often a device's thread looks after jobs that are away, when it has no work.
constexpr auto kIdleCheck = std::chrono::milliseconds(10);
// Jobs of a session that may be away at once: each may have a film and its planes.
constexpr std::ptrdiff_t kMostAway = 8;
constexpr double kLittle = 0.002;  // seconds of a device: a job that had less may be short

using Queue = FairQueue<std::unique_ptr<Work>>;

u64 sum_of(const std::vector<std::shared_ptr<Backend>>& backends, u64 (Backend::*of)() const) {
  const auto add = [of](u64 sum, const auto& backend) { return sum + (*backend.*of)(); };
  return std::accumulate(backends.begin(), backends.end(), u64(0), add);
}

}  // namespace

/// Owns: the backends, a thread for each, and the workers. Locks: mutex_, never across a call out.
class Engine::Impl final : public Others {
 public:
  Impl(std::vector<std::unique_ptr<Backend>> backends, const EngineOptions& options)
      : options_(options), denoiser_(options.device.denoiser, options.device.threads) {
    for (auto& backend : backends) devices_.push_back({.backend = std::move(backend)});
    workers_.emplace(Workers::Options{options.device.threads, options.credit, options.turn});
    for (u32 i = 0; i < devices_.size(); ++i)
      devices_[i].thread = std::thread([this, i] { device_loop(i); });
  }
  ~Impl() override {
    {
      const std::scoped_lock lock(mutex_);
      closing_ = true;
    }
    changed_.notify_all();
    for (DeviceThread& device : devices_) device.thread.join();
    workers_.reset();
    refuse_all();
  }

  void submit(std::unique_ptr<Work> work) {
    {
      const std::scoped_lock lock(mutex_);
      push(std::move(work));
    }
    changed_.notify_all();
  }

  void invite(const std::shared_ptr<Spread>& spread) override {
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

  /// By device.
  [[nodiscard]] std::vector<std::shared_ptr<Backend>> backends() const {
    const std::scoped_lock lock(mutex_);
    return kept_backends();
  }
  [[nodiscard]] const EngineOptions& options() const { return options_; }
  [[nodiscard]] Denoiser& denoiser() { return denoiser_; }
  [[nodiscard]] Load load() const {
    const std::scoped_lock lock(mutex_);
    Load load{.jobs = u32(ready_.size() + away_.size()),
              .seconds_a_job = seconds_a_job_,
              .is_lost = std::ranges::all_of(devices_, &DeviceThread::is_lost),
              .losses = losses_,
              .lost_because = lost_because_,
              .needs_new_process = std::ranges::all_of(devices_, &DeviceThread::is_beyond_us)};
    for (const DeviceThread& device : devices_) {
      const auto still = Clock::now() - device.step_began.value_or(Clock::now());
      load.still_seconds =
          std::max(load.still_seconds, std::chrono::duration<double>(still).count());
    }
    return load;
  }

 private:
  void device_loop(u32 index);
  void push(std::unique_ptr<Work> work);  // under mutex_
  void send_away(u32 index, const Queue::Turn& turn, std::vector<Errand> errands);
  void come_back(std::list<Away>::iterator away);
  void count_waiting();                        // under mutex_
  void set_fresh(Work& work, bool is_fresh) {  // under mutex_
    waiting_.fresh += u32(is_fresh) - u32(std::exchange(work.is_fresh, is_fresh));
  }
  [[nodiscard]] std::optional<Queue::Turn> next(u32 index);
  [[nodiscard]] bool may_take(u32 index, const Work& work) const;  // under mutex_
  std::unique_ptr<Work> account(u32 index, const Queue::Turn& turn, double cost, bool is_done);
  void refuse_interrupted(u32 index);
  void refuse_all();
  void replace_backend(u32 index);
  [[nodiscard]] std::shared_ptr<Backend> remake(u32 index);
  [[nodiscard]] std::vector<std::shared_ptr<Backend>> kept_backends() const {  // under mutex_
    std::vector<std::shared_ptr<Backend>> backends;
    for (const DeviceThread& device : devices_) backends.push_back(device.backend);
    return backends;
  }

  const EngineOptions options_;
  Denoiser denoiser_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<DeviceThread> devices_;
  Queue ready_{options_.credit, options_.turn};
  std::list<Away> away_;
  WaitingJobs waiting_;
  double seconds_a_job_ = 0;
  u32 losses_ = 0;
  std::string lost_because_;
  bool closing_ = false;
  std::optional<Workers> workers_;
};

void Engine::Impl::push(std::unique_ptr<Work> work) {
  const Origin origin = work->origin();
  const bool is_short = work->is_short(), is_back = work->begun.has_value();
  Work& pushed = *work;
  const bool is_next = ready_.push(origin, is_short, std::move(work), is_back);
  set_fresh(pushed, is_next && pushed.seconds < kLittle);
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
    const bool is_lost = device.backend->is_lost();
    const auto done = account(index, *turn, cost, is_done && !is_lost);
    if (done)
      done->finish();
    else if (auto errands = turn->item()->take_errands(); !errands.empty() && !is_lost)
      send_away(index, *turn, std::move(errands));
    if (is_lost) replace_backend(index);
  }
}

/// The workers have what it waits for; the device goes on with others.
void Engine::Impl::send_away(u32 index, const Queue::Turn& turn, std::vector<Errand> errands) {
  std::unique_lock lock(mutex_);
  const auto away =
      away_.insert(away_.end(), Away{.backend = devices_[index].backend, .work = ready_.pop(turn)});
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
std::optional<Queue::Turn> Engine::Impl::next(u32 index) {
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
  work.seconds += cost;
  work.runs = false;
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

/// What has begun holds memory of the lost device; what has not, and derived data, starts again.
void Engine::Impl::replace_backend(u32 index) {
  std::vector<std::unique_ptr<Work>> begun;
  {
    const std::scoped_lock lock(mutex_);
    devices_[index].is_lost = true;
    ++losses_;
    begun = ready_.take_if(
        [&](const auto& work) { return work->begun.has_value() && work->place == index; });
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

/// What is interrupted and waits, but for what other devices began: its memory is theirs.
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

Expected<std::unique_ptr<Engine>> Engine::create(const EngineOptions& options) {
  const auto there = device_count(options.backend);
  if (!there) return std::unexpected(there.error());
  std::vector<std::unique_ptr<Backend>> backends;
  const u32 count = options.devices > 0 ? options.devices : *there;
  for (u32 i = 0; i < count; ++i) {
    BackendOptions own = options.device;
    own.index = i;
    own.cache_bytes /= count;
    auto backend = make_backend(options.backend, own);
    if (!backend) return std::unexpected(std::move(backend).error());
    backends.push_back(*std::move(backend));
  }
  return std::unique_ptr<Engine>(new Engine(std::make_unique<Impl>(std::move(backends), options)));
}

Engine::Engine(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Engine::~Engine() = default;

Status Engine::submit(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
                      std::stop_token stop) {
  HELIO_TRY(check_job(*job, impl_->options().limits));
  if (std::ranges::count(job->planes, Plane::DENOISED) > 0) HELIO_TRY(impl_->denoiser().ready());
  if (job->on_device && !shared_memory())
    return fail(Code::kFailedPrecondition, "memory",
                fmt::format("this daemon renders with the backend {}, which has no memory of a GPU "
                            "to share; start it with --backend cuda, or ask for planes on the host",
                            backend_name()));
  impl_->submit(std::make_unique<RenderWork>(std::move(job), std::move(sink), std::move(stop)));
  return {};
}

void Engine::submit(std::shared_ptr<const QueryJob> query,
                    std::function<void(Expected<QueryResult>)> done, std::stop_token stop) {
  impl_->submit(std::make_unique<QueryWork>(std::move(query), std::move(done), std::move(stop)));
}

std::string_view Engine::backend_name() const { return impl_->backends().front()->name(); }
std::string Engine::cpu_features() const { return impl_->backends().front()->cpu_features(); }
u32 Engine::devices() const { return u32(impl_->backends().size()); }
u64 Engine::derived_bytes() const { return sum_of(impl_->backends(), &Backend::derived_bytes); }
u64 Engine::scenes_made_again() const {
  return sum_of(impl_->backends(), &Backend::scenes_made_again);
}
u64 Engine::uploaded_bytes() const { return sum_of(impl_->backends(), &Backend::uploaded_bytes); }
MemoryUse Engine::memory() const {
  MemoryUse all;
  for (const auto& backend : impl_->backends()) {
    const MemoryUse one = backend->memory();
    all.used += one.used;
    all.budget += one.budget;
  }
  return all;
}
Load Engine::load() const { return impl_->load(); }
std::shared_ptr<SharedMemorySource> Engine::shared_memory() const {
  return impl_->backends().front()->shared_memory();
}

}  // namespace heliograph
