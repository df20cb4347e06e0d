// The queue of jobs, the devices' threads, and the thread that makes derived data beside them.
#include "renderer/engine/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>

#include "renderer/engine/check.h"
#include "renderer/engine/fair_queue.h"
#include "renderer/engine/work.h"

namespace heliograph {
namespace {

using Clock = Work::Clock;

/// How much a job counts in the mean of their seconds.
constexpr double kNewest = 0.1;
/// Between two attempts to make a backend in the place of a lost one.
constexpr auto kRemake = std::chrono::milliseconds(500);
/// How often a device's thread looks after jobs that wait for derived data, when it has no work.
constexpr auto kIdleCheck = std::chrono::milliseconds(10);

using Queue = FairQueue<std::unique_ptr<Work>>;

/// A device and the thread that owns it.
struct DeviceThread {
  std::shared_ptr<Backend> backend;  // replaced by the thread
  std::optional<Clock::time_point> step_began{};
  bool is_idle = false;
  bool is_lost = false;
  bool is_beyond_us = false;  // lost, and not to be had again in this process
  std::thread thread{};
};

}  // namespace

/// Owns: the backends, a thread for each and one that warms. Locks: mutex_, never across a call
/// out.
class Engine::Impl final : public Others {
 public:
  Impl(std::vector<std::unique_ptr<Backend>> backends, const EngineOptions& options)
      : options_(options), denoiser_(options.device.denoiser, options.device.threads) {
    for (auto& backend : backends) devices_.push_back({.backend = std::move(backend)});
    for (u32 i = 0; i < devices_.size(); ++i)
      devices_[i].thread = std::thread([this, i] { device_loop(i); });
    warmer_ = std::thread([this] { warm_loop(); });
  }
  ~Impl() override {
    {
      const std::scoped_lock lock(mutex_);
      closing_ = true;
    }
    changed_.notify_all();
    for (DeviceThread& device : devices_) device.thread.join();
    warmer_.join();
    refuse_all();
  }

  void submit(std::unique_ptr<Work> work) {
    const auto backends = this->backends();
    const bool ready = std::ranges::all_of(backends, [&](const auto& backend) {
      return std::ranges::all_of(work->needs(), [&](const auto& s) { return backend->ready(*s); });
    });
    {
      const std::scoped_lock lock(mutex_);
      if (ready && backends == kept_backends())
        push(std::move(work));
      else
        cold_.push_back(std::move(work));
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
    Load load{.jobs = u32(ready_.size() + cold_.size()),
              .seconds_a_job = seconds_a_job_,
              .is_lost = all_lost(),
              .losses = losses_,
              .lost_because = lost_because_,
              .needs_new_process = std::ranges::all_of(devices_, &DeviceThread::is_beyond_us)};
    for (const DeviceThread& device : devices_) {
      if (!device.step_began) continue;
      const std::chrono::duration<double> still = Clock::now() - *device.step_began;
      load.still_seconds = std::max(load.still_seconds, still.count());
    }
    return load;
  }

 private:
  void device_loop(u32 index);
  void warm_loop();
  void push(std::unique_ptr<Work> work);  // under mutex_
  void count_waiting();                   // under mutex_
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
  [[nodiscard]] bool all_lost() const {  // under mutex_
    return std::ranges::all_of(devices_, [](const auto& device) { return device.is_lost; });
  }

  const EngineOptions options_;
  Denoiser denoiser_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<DeviceThread> devices_;
  Queue ready_{options_.credit, options_.turn};  // warm
  std::deque<std::unique_ptr<Work>> cold_;       // waiting for it
  std::atomic<u32> waiting_ = 0;                 // of the ready ones, those that do not run
  double seconds_a_job_ = 0;
  u32 losses_ = 0;
  std::string lost_because_;
  bool closing_ = false;
  std::thread warmer_;
};

void Engine::Impl::push(std::unique_ptr<Work> work) {
  const Origin origin = work->origin();
  const bool is_short = work->is_short();
  ready_.push(origin, is_short, std::move(work));
  count_waiting();
}

void Engine::Impl::count_waiting() {
  const auto runs = [](const DeviceThread& device) { return device.step_began.has_value(); };
  waiting_ = u32(ready_.size()) - u32(std::ranges::count_if(devices_, runs));
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
    if (const auto done = account(index, *turn, cost, is_done && !is_lost)) done->finish();
    if (is_lost) replace_backend(index);
  }
}

/// Work stays on the device that began it, or whose memory it is for. Other work goes to the first
/// idle device: who asks for one thing after the other finds its scene where it was.
bool Engine::Impl::may_take(u32 index, const Work& work) const {
  if (work.runs || work.interrupt().requested()) return false;
  if (work.place != kernels::kNone) return work.place == index;
  return std::none_of(devices_.begin(), devices_.begin() + index,
                      [](const DeviceThread& other) { return other.is_idle; });
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
      if (cold_.empty() && ready_.empty())
        changed_.wait(lock, [&] { return something() || !cold_.empty() || !ready_.empty(); });
      else
        changed_.wait_for(lock, kIdleCheck, something);
      device.is_idle = false;
    }
    if (closing_) return {};
    if (!turn) continue;
    Work& work = *turn->item();
    device.step_began = Clock::now();
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
  std::ranges::move(cold_, std::back_inserter(left));
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
    if (all_lost())
      std::ranges::move(ready_.take_if([](const auto& work) { return !work->begun; }),
                        std::back_inserter(cold_));
  }
  for (auto& work : begun)
    work->refuse({.code = Code::kUnavailable,
                  .message = "the device was lost while it rendered this, and is started again; "
                             "ask again",
                  .where = "",
                  .retry_seconds = 1});
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
  {
    const std::scoped_lock lock(mutex_);
    interrupted = ready_.take_if(is_interrupted);
    std::erase_if(cold_, [&](auto& work) {
      if (!is_interrupted(work)) return false;
      interrupted.push_back(std::move(work));
      return true;
    });
  }
  for (auto& work : interrupted) work->refuse(work->interrupt().status().error());
}

void Engine::Impl::warm_loop() {
  for (;;) {
    const Work* first = nullptr;
    Snapshots snapshots;
    std::vector<std::shared_ptr<Backend>> backends;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closing_ || (!cold_.empty() && !all_lost()); });
      if (closing_) return;
      first = cold_.front().get();
      snapshots = first->needs();
      backends = kept_backends();
    }
    // What fails here fails again, and is told, when the job prepares its scene.
    for (const auto& backend : backends)
      for (const auto& snapshot : snapshots) (void)guard([&] { return backend->warm(*snapshot); });
    {
      const std::scoped_lock lock(mutex_);
      // It may have been refused meanwhile, or a backend replaced; then it begins again.
      if (backends == kept_backends() && !cold_.empty() && cold_.front().get() == first) {
        push(std::move(cold_.front()));
        cold_.pop_front();
      }
    }
    changed_.notify_all();
  }
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
u64 Engine::derived_bytes() const {
  u64 bytes = 0;
  for (const auto& backend : impl_->backends()) bytes += backend->derived_bytes();
  return bytes;
}
u64 Engine::uploaded_bytes() const {
  u64 bytes = 0;
  for (const auto& backend : impl_->backends()) bytes += backend->uploaded_bytes();
  return bytes;
}
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
