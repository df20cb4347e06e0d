// The queue of jobs, the device thread, and the thread that makes derived data beside it.
#include "renderer/engine/engine.h"

#include <algorithm>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <new>
#include <thread>

#include "renderer/engine/check.h"
#include "renderer/engine/runner.h"

namespace heliograph {
namespace {

/// How often the device thread looks after jobs that wait for derived data, when it has no work.
constexpr auto kIdleCheck = std::chrono::milliseconds(10);

/// Something queued: a job or a query. Its owner calls exactly one of run() and refuse().
class Work {
 public:
  Work(std::shared_ptr<const Snapshot> snapshot, Interrupt interrupt)
      : snapshot_(std::move(snapshot)), interrupt_(std::move(interrupt)) {}
  virtual ~Work() = default;
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;
  virtual void run(Backend& backend, Denoiser& denoiser, std::chrono::milliseconds slice,
                   const std::function<Status()>& between) = 0;
  virtual void refuse(Error error) = 0;
  [[nodiscard]] const std::shared_ptr<const Snapshot>& snapshot() const { return snapshot_; }
  [[nodiscard]] const Interrupt& interrupt() const { return interrupt_; }

 private:
  std::shared_ptr<const Snapshot> snapshot_;
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
      : Work(job->snapshot, {std::move(stop), job->deadline}),
        job_(std::move(job)),
        sink_(std::move(sink)) {}
  void run(Backend& backend, Denoiser& denoiser, std::chrono::milliseconds slice,
           const std::function<Status()>& between) override {
    sink_->done(guard([&] {
      return Runner(job_, {backend, denoiser, *sink_, interrupt(), slice, between}).run();
    }));
  }
  void refuse(Error error) override { sink_->done(std::unexpected(std::move(error))); }

 private:
  std::shared_ptr<const RenderJob> job_;
  std::shared_ptr<JobSink> sink_;
};

class QueryWork final : public Work {
 public:
  using Done = std::function<void(Expected<QueryResult>)>;
  QueryWork(std::shared_ptr<const QueryJob> query, Done done, std::stop_token stop)
      : Work(query->snapshot, {std::move(stop), std::nullopt}),
        query_(std::move(query)),
        done_(std::move(done)) {}
  void run(Backend& backend, Denoiser&, std::chrono::milliseconds,
           const std::function<Status()>&) override {
    done_(guard([&] { return backend.query(*query_, interrupt()); }));
  }
  void refuse(Error error) override { done_(std::unexpected(std::move(error))); }

 private:
  std::shared_ptr<const QueryJob> query_;
  Done done_;
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
    const bool ready = backend_->ready(*work->snapshot());
    {
      const std::scoped_lock lock(mutex_);
      (ready ? ready_ : cold_).push_back(std::move(work));
    }
    changed_.notify_all();
  }

  [[nodiscard]] const Backend& backend() const { return *backend_; }
  [[nodiscard]] const JobLimits& limits() const { return options_.limits; }
  [[nodiscard]] Denoiser& denoiser() { return denoiser_; }
  [[nodiscard]] u32 queued() const {
    const std::scoped_lock lock(mutex_);
    return u32(ready_.size() + cold_.size()) + running_;
  }

 private:
  using Queue = std::deque<std::unique_ptr<Work>>;

  void device_loop();
  void warm_loop();
  Status between();
  void refuse_interrupted();

  const std::unique_ptr<Backend> backend_;
  const EngineOptions options_;
  Denoiser denoiser_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Queue ready_;  // derived data made
  Queue cold_;   // waiting for it
  u32 running_ = 0;
  bool closing_ = false;
  std::thread device_, warmer_;
};

void Engine::Impl::device_loop() {
  for (;;) {
    std::unique_ptr<Work> work;
    {
      std::unique_lock lock(mutex_);
      const auto something = [&] { return closing_ || !ready_.empty(); };
      if (cold_.empty())
        changed_.wait(lock, [&] { return something() || !cold_.empty(); });
      else
        changed_.wait_for(lock, kIdleCheck, something);
      if (closing_) break;
      if (!ready_.empty()) {
        work = std::move(ready_.front());
        ready_.pop_front();
        running_ = 1;
      }
    }
    refuse_interrupted();
    if (!work) continue;
    if (auto status = work->interrupt().status(); !status)
      work->refuse(std::move(status).error());
    else
      work->run(*backend_, denoiser_, options_.slice, [this] { return between(); });
    work.reset();
    const std::scoped_lock lock(mutex_);
    running_ = 0;
  }
  Queue left;
  {
    const std::scoped_lock lock(mutex_);
    left.swap(ready_);
    for (auto& work : cold_) left.push_back(std::move(work));
    cold_.clear();
  }
  for (auto& work : left)
    work->refuse({.code = Code::kUnavailable, .message = "the renderer is shutting down"});
}

Status Engine::Impl::between() {
  refuse_interrupted();
  const std::scoped_lock lock(mutex_);
  if (closing_) return fail(Code::kUnavailable, "", "the renderer is shutting down");
  return {};
}

void Engine::Impl::refuse_interrupted() {
  Queue interrupted;
  {
    const std::scoped_lock lock(mutex_);
    for (Queue* queue : {&ready_, &cold_})
      for (auto work = queue->begin(); work != queue->end();) {
        if (!(*work)->interrupt().requested()) {
          ++work;
          continue;
        }
        interrupted.push_back(std::move(*work));
        work = queue->erase(work);
      }
  }
  for (auto& work : interrupted) work->refuse(work->interrupt().status().error());
}

void Engine::Impl::warm_loop() {
  for (;;) {
    const Work* first = nullptr;
    std::shared_ptr<const Snapshot> snapshot;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return closing_ || !cold_.empty(); });
      if (closing_) return;
      first = cold_.front().get();
      snapshot = first->snapshot();
    }
    // What fails here fails again, and is told, when the job prepares its scene.
    (void)guard([&] { return backend_->warm(*snapshot); });
    {
      const std::scoped_lock lock(mutex_);
      // It may have been refused meanwhile; then another one is first.
      if (!cold_.empty() && cold_.front().get() == first) {
        ready_.push_back(std::move(cold_.front()));
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
  HELIO_TRY(check_job(*job, impl_->limits()));
  if (std::ranges::count(job->planes, Plane::DENOISED) > 0) HELIO_TRY(impl_->denoiser().ready());
  impl_->submit(std::make_unique<RenderWork>(std::move(job), std::move(sink), std::move(stop)));
  return {};
}

void Engine::submit(std::shared_ptr<const QueryJob> query,
                    std::function<void(Expected<QueryResult>)> done, std::stop_token stop) {
  impl_->submit(std::make_unique<QueryWork>(std::move(query), std::move(done), std::move(stop)));
}

std::string_view Engine::backend_name() const { return impl_->backend().name(); }
std::string Engine::cpu_features() const { return impl_->backend().cpu_features(); }
u64 Engine::derived_bytes() const { return impl_->backend().derived_bytes(); }
u32 Engine::queued() const { return impl_->queued(); }

}  // namespace heliograph
