// The queue of jobs, the device thread, and the thread that makes derived data beside it.
#include "renderer/engine/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <new>
#include <optional>
#include <thread>

#include "renderer/engine/check.h"
#include "renderer/engine/fair_queue.h"
#include "renderer/engine/runner.h"

namespace heliograph {
namespace {

using Clock = std::chrono::steady_clock;
using Snapshots = std::vector<std::shared_ptr<const Snapshot>>;

/// How much a job counts in the mean of their seconds.
constexpr double kNewest = 0.1;
/// Between two attempts to make a backend in the place of a lost one.
constexpr auto kRemake = std::chrono::milliseconds(500);
/// How often the device thread looks after jobs that wait for derived data, when it has no work.
constexpr auto kIdleCheck = std::chrono::milliseconds(10);

/// The device as a job sees it.
struct Device {
  Backend& backend;
  Denoiser& denoiser;
  std::chrono::milliseconds slice;
};

/// A job or a query. Its owner calls step() until that says that it is done, or refuse() once.
class Work {
 public:
  /// needs   snapshots whose derived data it reads
  Work(Snapshots needs, Interrupt interrupt)
      : needs_(std::move(needs)), interrupt_(std::move(interrupt)) {}
  virtual ~Work() = default;
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;
  /// Runs for a slice; true when it is done. Its result is told by the next call, finish().
  [[nodiscard]] virtual bool step(const Device& device) = 0;
  virtual void finish() = 0;
  virtual void refuse(Error error) = 0;
  [[nodiscard]] virtual const Origin& origin() const = 0;
  /// Whether it goes in the lane of labels and queries.
  [[nodiscard]] virtual bool is_short() const = 0;
  [[nodiscard]] const Snapshots& needs() const { return needs_; }
  [[nodiscard]] const Interrupt& interrupt() const { return interrupt_; }
  [[nodiscard]] double waited_seconds() const {
    return std::chrono::duration<double>(begun.value_or(Clock::now()) - queued_).count();
  }

  double seconds = 0;                        // of the device, so far
  std::optional<Clock::time_point> begun{};  // when the device first had it

 private:
  const Clock::time_point queued_ = Clock::now();
  Snapshots needs_;
  Interrupt interrupt_;
};

/// Memory is the one thing that may run out anywhere: an error of the job, not of the process.
template <class F>
auto guard(F&& f) -> decltype(f()) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return fail(Code::kResourceExhausted, "", "out of memory; ask for less at once");
  }
}

class RenderWork final : public Work {
 public:
  RenderWork(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
             std::stop_token stop)
      : Work(needed_snapshots(*job), {std::move(stop), job->deadline}),
        job_(std::move(job)),
        sink_(std::move(sink)) {}
  bool step(const Device& device) override {
    result_ = guard([&]() -> Status {
      if (!runner_)
        runner_.emplace(job_, RunnerContext{device.backend, device.denoiser, *sink_, interrupt(),
                                            device.slice});
      is_done_ = runner_->step();
      return is_done_ ? runner_->result() : Status{};
    });
    return is_done_ || !result_;
  }
  void finish() override { sink_->done(result_, spent()); }
  void refuse(Error error) override { sink_->done(std::unexpected(std::move(error)), spent()); }
  [[nodiscard]] const Origin& origin() const override { return job_->origin; }
  [[nodiscard]] bool is_short() const override { return !wants_samples(*job_); }

 private:
  [[nodiscard]] Spent spent() const {
    Spent spent{.seconds = seconds, .waited_seconds = waited_seconds()};
    if (runner_) spent.samples = runner_->samples(), spent.rays = runner_->rays();
    return spent;
  }

  std::shared_ptr<const RenderJob> job_;
  std::shared_ptr<JobSink> sink_;
  std::optional<Runner> runner_;
  Status result_;
  bool is_done_ = false;
};

class QueryWork final : public Work {
 public:
  using Done = std::function<void(Expected<QueryResult>)>;
  QueryWork(std::shared_ptr<const QueryJob> query, Done done, std::stop_token stop)
      : Work({query->snapshot}, {std::move(stop), std::nullopt}),
        query_(std::move(query)),
        done_(std::move(done)) {}
  bool step(const Device& device) override {
    result_ = guard([&] { return device.backend.query(*query_, interrupt()); });
    return true;
  }
  void finish() override { done_(std::move(result_)); }
  void refuse(Error error) override { done_(std::unexpected(std::move(error))); }
  [[nodiscard]] const Origin& origin() const override { return query_->origin; }
  [[nodiscard]] bool is_short() const override { return true; }

 private:
  std::shared_ptr<const QueryJob> query_;
  Done done_;
  Expected<QueryResult> result_;
};

}  // namespace

/// Owns: the backend and two threads. Locks: mutex_, never across a call out.
class Engine::Impl {
 public:
  Impl(std::unique_ptr<Backend> backend, const EngineOptions& options)
      : backend_(std::move(backend)),
        options_(options),
        denoiser_(options.denoiser, options.device.threads) {
    device_ = std::thread([this] { device_loop(); });
    warmer_ = std::thread([this] { warm_loop(); });
  }
  ~Impl() {
    {
      const std::scoped_lock lock(mutex_);
      closing_ = true;
    }
    changed_.notify_all();
    device_.join();
    warmer_.join();
  }

  void submit(std::unique_ptr<Work> work) {
    const auto backend = this->backend();
    const bool ready =
        std::ranges::all_of(work->needs(), [&](const auto& s) { return backend->ready(*s); });
    {
      const std::scoped_lock lock(mutex_);
      if (ready && backend == backend_)
        push(std::move(work));
      else
        cold_.push_back(std::move(work));
    }
    changed_.notify_all();
  }

  [[nodiscard]] std::shared_ptr<Backend> backend() const {
    const std::scoped_lock lock(mutex_);
    return backend_;
  }
  [[nodiscard]] const EngineOptions& options() const { return options_; }
  [[nodiscard]] Denoiser& denoiser() { return denoiser_; }
  [[nodiscard]] Load load() const {
    const std::scoped_lock lock(mutex_);
    const auto still = step_began_ ? Clock::now() - *step_began_ : Clock::duration(0);
    return {.jobs = u32(ready_.size() + cold_.size()),
            .seconds_a_job = seconds_a_job_,
            .still_seconds = std::chrono::duration<double>(still).count(),
            .is_lost = is_lost_,
            .losses = losses_};
  }

 private:
  void device_loop();
  void warm_loop();
  void push(std::unique_ptr<Work> work);  // under mutex_
  [[nodiscard]] Work* next();
  std::unique_ptr<Work> account(Work& work, double cost, bool is_done);
  void refuse_interrupted();
  void refuse_all();
  void replace_backend();
  [[nodiscard]] std::shared_ptr<Backend> remake();

  std::shared_ptr<Backend> backend_;  // replaced by the device thread
  const EngineOptions options_;
  Denoiser denoiser_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  FairQueue<std::unique_ptr<Work>> ready_{options_.credit, options_.turn};  // warm
  std::deque<std::unique_ptr<Work>> cold_;                                  // waiting for it
  double seconds_a_job_ = 0;
  std::optional<Clock::time_point> step_began_;
  bool is_lost_ = false;
  u32 losses_ = 0;
  bool closing_ = false;
  std::thread device_, warmer_;
};

void Engine::Impl::push(std::unique_ptr<Work> work) {
  const Origin origin = work->origin();
  const bool is_short = work->is_short();
  ready_.push(origin, is_short, std::move(work));
}

void Engine::Impl::device_loop() {
  while (Work* work = next()) {
    const auto start = Clock::now();
    const bool is_done = work->step({*backend_, denoiser_, options_.slice});
    const double cost = std::chrono::duration<double>(Clock::now() - start).count();
    const bool is_lost = backend_->is_lost();
    if (const auto done = account(*work, cost, is_done && !is_lost)) done->finish();
    if (is_lost) replace_backend();
  }
  refuse_all();
}

/// Waits for work; null when the engine closes. It stays in the queue while it runs.
Work* Engine::Impl::next() {
  for (;;) {
    refuse_interrupted();
    std::unique_lock lock(mutex_);
    const auto something = [&] { return closing_ || !ready_.empty(); };
    if (cold_.empty())
      changed_.wait(lock, [&] { return something() || !cold_.empty(); });
    else
      changed_.wait_for(lock, kIdleCheck, something);
    if (closing_) return nullptr;
    if (ready_.empty()) continue;
    Work* work = ready_.front().get();
    if (work->interrupt().requested()) continue;
    step_began_ = Clock::now();
    if (!work->begun) work->begun = step_began_;
    return work;
  }
}

std::unique_ptr<Work> Engine::Impl::account(Work& work, double cost, bool is_done) {
  const std::scoped_lock lock(mutex_);
  step_began_.reset();
  ready_.charge(cost);
  work.seconds += cost;
  if (!is_done) return nullptr;
  seconds_a_job_ += kNewest * (work.seconds - seconds_a_job_);
  return ready_.pop();
}

void Engine::Impl::refuse_all() {
  std::vector<std::unique_ptr<Work>> left;
  {
    const std::scoped_lock lock(mutex_);
    left = ready_.take_if([](const auto&) { return true; });
    std::ranges::move(cold_, std::back_inserter(left));
    cold_.clear();
  }
  for (auto& work : left)
    work->refuse({.code = Code::kUnavailable, .message = "the renderer is shutting down"});
}

/// What has begun holds memory of the lost device; what has not, and derived data, starts again.
void Engine::Impl::replace_backend() {
  std::vector<std::unique_ptr<Work>> begun;
  {
    const std::scoped_lock lock(mutex_);
    is_lost_ = true;
    ++losses_;
    begun = ready_.take_if([](const auto& work) { return work->begun.has_value(); });
    std::ranges::move(ready_.take_if([](const auto&) { return true; }), std::back_inserter(cold_));
  }
  for (auto& work : begun)
    work->refuse({.code = Code::kUnavailable,
                  .message = "the device was lost while it rendered this, and is started again; "
                             "ask again",
                  .where = "",
                  .retry_seconds = 1});
  begun.clear();
  auto backend = remake();
  if (!backend) return;
  {
    const std::scoped_lock lock(mutex_);
    backend_.swap(backend);
    is_lost_ = false;
  }
  changed_.notify_all();
}

/// Null when the engine closes.
std::shared_ptr<Backend> Engine::Impl::remake() {
  for (;;) {
    auto made = make_backend(options_.backend, options_.device);
    if (made) return *std::move(made);
    refuse_interrupted();
    std::unique_lock lock(mutex_);
    if (changed_.wait_for(lock, kRemake, [&] { return closing_; })) return nullptr;
  }
}

void Engine::Impl::refuse_interrupted() {
  const auto is_interrupted = [](const auto& work) { return work->interrupt().requested(); };
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
    std::shared_ptr<Backend> backend;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closing_ || (!cold_.empty() && !is_lost_); });
      if (closing_) return;
      first = cold_.front().get();
      snapshots = first->needs();
      backend = backend_;
    }
    // What fails here fails again, and is told, when the job prepares its scene.
    for (const auto& snapshot : snapshots) (void)guard([&] { return backend->warm(*snapshot); });
    {
      const std::scoped_lock lock(mutex_);
      // It may have been refused meanwhile, or the backend replaced; then it begins again.
      if (backend == backend_ && !cold_.empty() && cold_.front().get() == first) {
        push(std::move(cold_.front()));
        cold_.pop_front();
      }
    }
    changed_.notify_all();
  }
}

Expected<std::unique_ptr<Engine>> Engine::create(const EngineOptions& options) {
  auto backend = make_backend(options.backend, options.device);
  if (!backend) return std::unexpected(std::move(backend).error());
  return std::unique_ptr<Engine>(new Engine(std::make_unique<Impl>(*std::move(backend), options)));
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

std::string_view Engine::backend_name() const { return impl_->backend()->name(); }
std::string Engine::cpu_features() const { return impl_->backend()->cpu_features(); }
u64 Engine::derived_bytes() const { return impl_->backend()->derived_bytes(); }
u64 Engine::uploaded_bytes() const { return impl_->backend()->uploaded_bytes(); }
Load Engine::load() const { return impl_->load(); }
std::shared_ptr<SharedMemorySource> Engine::shared_memory() const {
  return impl_->backend()->shared_memory();
}

}  // namespace heliograph
