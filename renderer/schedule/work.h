// Work that waits for a device: render jobs and queries. Kept by engine_impl.cpp.
#pragma once

#include <functional>
#include <optional>
#include <utility>

#include "renderer/base/guard.h"
#include "renderer/schedule/engine.h"
#include "renderer/schedule/preparer.h"
#include "renderer/schedule/runner.h"

namespace heliograph {

/// The device as a job sees it.
struct Device {
  Backend& backend;
  Denoiser& denoiser;
  std::chrono::milliseconds slice;
  const WaitingJobs& waiting;
  Others* others;      // null: it is the only one
  u64 spread_samples;  // EngineOptions::spread_samples
};

/// A job or a query. Its owner calls step() until that returns that it is done, or refuse() once.
class Work {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Work(Interrupt interrupt) : interrupt_(std::move(interrupt)) {}
  virtual ~Work() = default;
  Work(const Work&) = delete;
  Work& operator=(const Work&) = delete;
  /// Runs for a slice; true when it is done. Its result is reported by the next call, finish().
  [[nodiscard]] virtual bool step(const Device& device) = 0;
  /// Takes what is to be done away from the device before the next step.
  [[nodiscard]] virtual std::vector<Errand> take_errands() = 0;
  virtual void finish() = 0;
  /// After finish(): what may take long to free.
  [[nodiscard]] virtual std::shared_ptr<const void> take_remains() { return nullptr; }
  virtual void refuse(Error error) = 0;
  [[nodiscard]] virtual const Origin& origin() const = 0;
  /// True if it goes in the lane of labels and queries.
  [[nodiscard]] virtual bool is_short() const = 0;
  [[nodiscard]] const Interrupt& interrupt() const { return interrupt_; }
  [[nodiscard]] double waited_seconds() const {
    return std::chrono::duration<double>(begun.value_or(Clock::now()) - queued_).count();
  }

  double seconds = 0;                        // of its device, so far
  double aside_seconds = 0;                  // that workers had what it waits for
  std::optional<Clock::time_point> begun{};  // when a device first had it
  u32 place = kernels::kNone;                // the index of that device: it stays there
  bool runs = false;                         // a slice of it
  bool is_fresh = false;                     // it may be short, and is its scene's next

 private:
  const Clock::time_point queued_ = Clock::now();
  Interrupt interrupt_;
};

class RenderWork final : public Work {
 public:
  RenderWork(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
             std::stop_token stop)
      : Work({std::move(stop), job->deadline}), job_(std::move(job)), sink_(std::move(sink)) {
    if (job_->on_device) place = 0;  // the one that shares its memory
  }
  bool step(const Device& device) override {
    result_ = guard([&]() -> Status {
      if (!runner_)
        runner_ = std::make_shared<Runner>(
            job_,
            RunnerContext{device.backend, device.denoiser, sink_.get(), interrupt(), device.slice,
                          &device.waiting, device.others, device.spread_samples});
      is_done_ = runner_->step();
      return is_done_ ? runner_->result() : Status{};
    });
    return is_done_ || !result_;
  }
  std::vector<Errand> take_errands() override {
    return runner_ ? runner_->take_errands() : std::vector<Errand>();
  }
  void finish() override { sink_->done(result_, spent()); }
  std::shared_ptr<const void> take_remains() override { return std::move(runner_); }
  void refuse(Error error) override { sink_->done(std::unexpected(std::move(error)), spent()); }
  [[nodiscard]] const Origin& origin() const override { return job_->origin; }
  [[nodiscard]] bool is_short() const override { return !wants_samples(*job_); }

 private:
  [[nodiscard]] Spent spent() const {
    Spent spent{
        .seconds = seconds, .waited_seconds = waited_seconds(), .aside_seconds = aside_seconds};
    if (!runner_) return spent;
    spent.helper_seconds = runner_->helper_seconds();
    spent.seconds += spent.helper_seconds;
    spent.samples = runner_->samples();
    spent.rays = runner_->rays();
    return spent;
  }

  std::shared_ptr<const RenderJob> job_;
  std::shared_ptr<JobSink> sink_;
  std::shared_ptr<Runner> runner_;
  Status result_;
  bool is_done_ = false;
};

/// Tiles of a picture whose job another device has. What it cannot do is left to that one.
class HelpWork final : public Work {
 public:
  HelpWork(std::shared_ptr<Spread> spread, u32 device)
      : Work({spread->closed(), spread->job()->deadline}), spread_(std::move(spread)) {
    place = device;
  }
  bool step(const Device& device) override {
    result_ = guard([&]() -> Status {
      if (!runner_)
        runner_.emplace(spread_, RunnerContext{device.backend, device.denoiser, nullptr,
                                               interrupt(), device.slice, &device.waiting});
      is_done_ = runner_->step();
      return is_done_ ? runner_->result() : Status{};
    });
    return is_done_ || !result_;
  }
  std::vector<Errand> take_errands() override {
    return runner_ ? runner_->take_errands() : std::vector<Errand>();
  }
  /// Who failed is not asked again.
  void finish() override {
    if (result_) spread_->leave(place);
  }
  void refuse(Error) override {}
  [[nodiscard]] const Origin& origin() const override { return spread_->job()->origin; }
  [[nodiscard]] bool is_short() const override { return false; }

 private:
  std::shared_ptr<Spread> spread_;
  std::optional<Runner> runner_;
  Status result_;
  bool is_done_ = false;
};

class QueryWork final : public Work {
 public:
  using Done = std::function<void(Expected<QueryResult>)>;
  QueryWork(std::shared_ptr<const QueryJob> query, Done done, std::stop_token stop)
      : Work({std::move(stop), std::nullopt}), query_(std::move(query)), done_(std::move(done)) {}
  bool step(const Device& device) override {
    if (is_answered_) return true;
    const TimeSpan span{query_->time, query_->time};
    if (!preparer_) preparer_.emplace(device.backend, SceneAt{query_->snapshot, span}, interrupt());
    result_ = guard([&]() -> Expected<QueryResult> {
      errands_ = preparer_->next();
      if (!errands_.empty()) return QueryResult{};
      auto scene = preparer_->take();
      if (!scene) return std::unexpected(std::move(scene).error());
      scene_ = *std::move(scene);
      if (seconds_of_query() < kQuickQuery || !device.backend.info().finishes_elsewhere)
        return run_on(device.backend, [&] { return device.backend.query(*query_, interrupt()); });
      errands_.push_back({.seconds = seconds_of_query(),
                          .run = [this, &backend = device.backend](const Interrupt&) {
                            result_ = guard([&] { return backend.query(*query_, interrupt()); });
                          }});
      is_answered_ = true;
      return fail(Code::kCancelled, "", "the query was given up");
    });
    return errands_.empty();
  }
  std::vector<Errand> take_errands() override { return std::exchange(errands_, {}); }
  void finish() override { done_(std::move(result_)); }
  void refuse(Error error) override { done_(std::unexpected(std::move(error))); }
  [[nodiscard]] const Origin& origin() const override { return query_->origin; }
  [[nodiscard]] bool is_short() const override { return true; }

 private:
  static constexpr double kQuickQuery = 1e-3;  // seconds that a device may have for it
  static constexpr double kOfItem = 5e-7;      // of a core, about

  [[nodiscard]] double seconds_of_query() const { return kOfItem * double(items_of(*query_)); }

  std::shared_ptr<const QueryJob> query_;
  Done done_;
  std::optional<Preparer> preparer_;
  std::shared_ptr<const DeviceScene> scene_;  // kept for the query
  std::vector<Errand> errands_;
  bool is_answered_ = false;  // once the errand ran
  Expected<QueryResult> result_;
};

}  // namespace heliograph
