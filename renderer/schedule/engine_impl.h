// Parts of an engine: the queue of jobs, the devices' threads, and jobs that are away from them.
#pragma once

#include <condition_variable>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "renderer/schedule/away.h"
#include "renderer/schedule/engine.h"

namespace heliograph {

/// Owns: the backends, a thread for each, and the workers. Locks: mutex_, never across a call out.
class Engine::Impl final : public Others {
 public:
  Impl(std::vector<std::unique_ptr<Backend>> backends, const EngineOptions& options);
  ~Impl() override;

  void submit(std::unique_ptr<Work> work);
  void invite(const std::shared_ptr<Spread>& spread) override;

  /// By device.
  [[nodiscard]] std::vector<std::shared_ptr<Backend>> backends() const {
    const std::scoped_lock lock(mutex_);
    return kept_backends();
  }
  [[nodiscard]] const EngineOptions& options() const { return options_; }
  [[nodiscard]] Denoiser& denoiser() { return denoiser_; }
  [[nodiscard]] Load load() const;

 private:
  using Clock = Work::Clock;
  using Queue = FairQueue<std::unique_ptr<Work>>;

  void device_loop(u32 index);
  void end(u32 index, Work& work);
  void push(std::unique_ptr<Work> work);  // under mutex_
  void send_away(u32 index, const Queue::Turn& turn, std::vector<Errand> errands);
  void come_back(std::list<Away>::iterator away);
  void count_waiting();                        // under mutex_
  void set_fresh(Work& work, bool is_fresh) {  // under mutex_
    waiting_.fresh += u32(is_fresh) - u32(std::exchange(work.is_fresh, is_fresh));
  }
  /// True if no other session had a device lately, nor, at the same time, another of its scenes.
  [[nodiscard]] bool is_alone(const Origin& origin) const;
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
  Queue ready_{options_.credit, options_.turn, options_.little};
  std::list<Away> away_;
  LastServed sessions_, scenes_at_once_;
  WaitingJobs waiting_;
  double seconds_a_job_ = 0;
  u32 losses_ = 0;
  std::string lost_because_;
  bool closing_ = false;
  std::optional<Workers> workers_;
};

}  // namespace heliograph
