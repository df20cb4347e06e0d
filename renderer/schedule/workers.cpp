// Errands and who waits for them.
#include "renderer/schedule/workers.h"

#include <algorithm>
#include <chrono>
#include <limits>

#include "renderer/base/guard.h"
#include "renderer/base/parallel.h"

namespace heliograph {
namespace {

using Clock = std::chrono::steady_clock;

// Seconds of a core: what is shorter is done by threads that longer work never has.
constexpr double kShort = 0.02, kMedium = 1;
constexpr u32 kManyCores = 8;  // from then on two threads take long work

bool is_medium(const Errand& errand) {
  return errand.seconds > kShort && errand.seconds <= kMedium;
}

}  // namespace

/// Long work is seldom, and has all cores that are free; short work is not worth a second one.
std::vector<Workers::Post> Workers::posts(u32 threads) {
  if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
  constexpr double kAny = std::numeric_limits<double>::infinity();
  std::vector<Post> posts{{kAny, threads}, {kShort, 1}};
  if (threads > 1) posts.push_back({kMedium, threads});
  if (threads >= kManyCores)
    posts.insert(posts.end(), {{kAny, threads}, {kMedium, threads}, {kShort, 1}});
  return posts;
}

Workers::Workers(const Options& options)
    : limit_(options.threads),
      is_alone_(options.is_alone),
      queue_(options.credit, options.turn, 0) {
  for (const Post& post : posts(options.threads))
    threads_.emplace_back([this, post] { loop(post); });
}

Workers::~Workers() {
  {
    const std::scoped_lock lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
}

void Workers::run(const std::shared_ptr<Group>& group, const Origin& origin,
                  std::vector<Errand> errands, const std::shared_ptr<const void>& owner) {
  {
    const std::scoped_lock lock(mutex_);
    group->left_ = errands.size();
    for (Errand& errand : errands) {
      if (join(group, errand)) continue;
      auto task = std::make_shared<Task>(
          Task{.errand = std::move(errand), .origin = origin, .owner = owner, .groups = {group}});
      if (task->is_shared()) shared_[task->errand.key] = task;
      const bool is_short = task->errand.seconds <= kShort;
      queue_.push(origin, is_short, std::move(task));
    }
  }
  changed_.notify_all();
}

/// Under mutex_. Whether somebody has asked for the same before.
bool Workers::join(const std::shared_ptr<Group>& group, const Errand& errand) {
  const auto same = shared_.find(errand.key);
  if (same == shared_.end()) return false;
  same->second->groups.push_back(group);
  return true;
}

void Workers::abandon(const std::shared_ptr<Group>& group) {
  std::vector<std::shared_ptr<Task>> unwanted;  // destroyed without the lock
  {
    const std::scoped_lock lock(mutex_);
    if (group->left_ == 0) return;
    unwanted = queue_.take_if([&](const auto& task) {
      if (task->runs && !task->is_shared()) return false;
      const std::size_t gone = std::erase(task->groups, group);
      group->left_ -= gone;
      if (gone > 0 && task->groups.empty()) {
        forget(task);
        task->stop.request_stop();
      }
      return !task->runs && task->groups.empty();
    });
    if (group->left_ > 0) return;
  }
  group->done_();
}

/// Who wants the same from now on has it done anew.
void Workers::forget(const std::shared_ptr<Task>& task) {
  const auto known = shared_.find(task->errand.key);
  if (known != shared_.end() && known->second == task) shared_.erase(known);
}

/// True if a thread may take a task. Of medium errands as many run at once as there are threads for
/// long ones: a second one has a thread only where the other is long.
bool Workers::may_take(const Task& task, const Post& post) const {
  if (task.runs || task.errand.seconds > post.most_seconds) return false;
  return !is_medium(task.errand) || medium_ < (post.threads < kManyCores ? 1 : 2);
}

/// Memory that ran out here runs out again, and is reported, when the job needs the result.
void Workers::run(const Task& task, const Post& post, Arenas& arenas) {
  const Interrupt interrupt{.stop = task.stop.get_token(), .deadline = {}};
  const auto errand = [&] {
    (void)guard([&]() -> Status { return task.errand.run(interrupt), Status{}; });
  };
  if (task.errand.seconds <= kShort || is_alone_(task.origin)) return run_in(arenas.all, errand);
  if (++beside_ < post.threads)
    run_beside(arenas.half, errand);
  else
    run_in(arenas.half, errand);
  --beside_;
}

void Workers::loop(const Post& post) {
  constexpr auto kLow = tbb::task_arena::priority::low;  // devices go first
  const int all = int(post.threads);
  // The second number: slots of callers. TBB warns where the others are more than its threads.
  Arenas arenas{.all{all, 1, kLow}, .half{(all + 1) / 2, all > 1 ? 0u : 1u, kLow}};
  std::unique_lock lock(mutex_);
  for (;;) {
    std::optional<Queue::Turn> turn;
    const auto has_turn = [&] {
      turn = queue_.next([&](const auto& task) { return may_take(*task, post); });
      return turn.has_value();
    };
    changed_.wait(lock, [&] { return closing_ || has_turn(); });
    if (closing_) return;
    const std::shared_ptr<Task> task = turn->item();
    task->runs = true;
    medium_ += u32(is_medium(task->errand));
    lock.unlock();
    const auto start = Clock::now();
    run(*task, post, arenas);
    lock.lock();
    queue_.charge(*turn, std::chrono::duration<double>(Clock::now() - start).count());
    (void)queue_.pop(*turn);
    medium_ -= u32(is_medium(task->errand));
    forget(task);
    auto done = std::move(task->groups);
    std::erase_if(done, [](const auto& group) { return --group->left_ > 0; });
    lock.unlock();
    if (is_medium(task->errand)) changed_.notify_all();
    task->errand.run = nullptr;  // what it holds goes before the others go on
    task->owner.reset();
    for (const auto& group : done) group->done_();
    lock.lock();
  }
}

}  // namespace heliograph
