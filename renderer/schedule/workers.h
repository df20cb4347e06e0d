// Threads beside the devices': derived data of scenes, and what is made of finished pictures. Used
// by the engine.
#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "renderer/base/parallel.h"
#include "renderer/device/errand.h"
#include "renderer/schedule/fair_queue.h"

namespace heliograph {

/// Does errands, by tenants in turn (fair_queue.h). Long ones never have all of its threads: one
/// thread does only what is short, so that it waits for nothing that is not. Where devices have
/// work of others, it has half of the threads, and leaves a core to them.
///
/// Owns: the threads. Thread: any. Errands throw std::bad_alloc at most.
class Workers {
 public:
  struct Options {
    u32 threads = 0;      // that the parts of one errand may have; 0: as many as there are cores
    double credit = 0.5;  // FairQueue
    double turn = 0.05;   // the same
    /// True if devices have had no work of others lately. Called from any thread.
    std::function<bool(const Origin&)> is_alone = [](const Origin&) { return true; };
  };
  /// Errands that somebody waits for.
  class Group {
   public:
    /// done   called once, by the thread that finds all done
    explicit Group(std::function<void()> done) : done_(std::move(done)) {}

   private:
    friend Workers;
    const std::function<void()> done_;
    std::size_t left_ = 0;  // by Workers::mutex_
  };

  explicit Workers(const Options& options);
  ~Workers();  // ends after the errands that run; what waits is dropped and reported to nobody

  /// owner   lives until the errands have run
  void run(const std::shared_ptr<Group>& group, const Origin& origin, std::vector<Errand> errands,
           const std::shared_ptr<const void>& owner);
  /// Waits no more for what has not begun, nor for what others may want too, which is interrupted
  /// where none of them waits either; done() may be called from here.
  void abandon(const std::shared_ptr<Group>& group);

 private:
  struct Task {
    Errand errand;
    Origin origin;  // of who wanted it first
    std::shared_ptr<const void> owner;
    std::vector<std::shared_ptr<Group>> groups;
    std::stop_source stop{};
    bool runs = false;
    [[nodiscard]] bool is_shared() const { return errand.key != decltype(errand.key){}; }
  };
  using Queue = FairQueue<std::shared_ptr<Task>>;
  /// Size of errands that a thread takes, and with how many threads.
  struct Post {
    double most_seconds;
    u32 threads;
  };
  /// Arenas for errands: with all threads, and beside devices that are busy for others.
  struct Arenas {
    tbb::task_arena all, half;
  };
  [[nodiscard]] static std::vector<Post> posts(u32 threads);
  void loop(const Post& post);
  [[nodiscard]] bool may_take(const Task& task, const Post& post) const;  // under mutex_
  void run(const Task& task, const Post& post, Arenas& arenas);
  void forget(const std::shared_ptr<Task>& task);  // under mutex_
  [[nodiscard]] bool join(const std::shared_ptr<Group>& group, const Errand& errand);

  const ThreadLimit limit_;  // of devices and workers
  const std::function<bool(const Origin&)> is_alone_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Queue queue_;
  std::map<decltype(Errand::key), std::shared_ptr<Task>> shared_;  // that wait or run
  u32 medium_ = 0;                                                 // that run
  std::atomic<u32> beside_ = 0;                                    // that TBB's own threads run
  bool closing_ = false;
  std::vector<std::jthread> threads_;
};

}  // namespace heliograph
