// Loops over the cores: the one place that names TBB. ThreadSanitizer does not see what TBB orders,
// which is built without it: under it pieces run on threads of their own, and Embree's tasks on
// one.
#pragma once

#include <tbb/global_control.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <semaphore>
#include <thread>

#ifdef __SANITIZE_THREAD__
#include <atomic>
#else
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#endif

#include "renderer/base/types.h"

namespace heliograph {

#ifdef __SANITIZE_THREAD__

inline const tbb::global_control kOneThread(tbb::global_control::max_allowed_parallelism, 1);

template <class Index, class F>
void parallel_ranges(Index count, Index grain, const F& f) {
  std::atomic<Index> next = 0;
  const auto work = [&] {
    for (Index begin; (begin = next.fetch_add(grain)) < count;)
      f(begin, std::min<Index>(count, begin + grain));
  };
  const std::jthread other(work);
  work();
}

template <class F, class G>
void parallel_invoke(const F& f, const G& g) {
  const std::jthread other(f);
  g();
}

template <class F>
decltype(auto) run_in(tbb::task_arena&, const F& f) {
  return f();
}

template <class F>
void run_beside(tbb::task_arena&, const F& f) {
  f();
}

template <class F>
decltype(auto) run_alone(const F& f) {
  return f();
}

#else

/// f(begin, end) for pieces, of `grain` or more, of what is below `count`, in any order.
template <class Index, class F>
void parallel_ranges(Index count, Index grain, const F& f) {
  if (count <= grain) {
    if (count > 0) f(Index(0), count);
    return;
  }
  tbb::parallel_for(tbb::blocked_range<Index>(0, count, grain),
                    [&](const auto& range) { f(range.begin(), range.end()); });
}

/// Both, in any order.
template <class F, class G>
void parallel_invoke(const F& f, const G& g) {
  tbb::parallel_invoke(f, g);
}

/// f() and its parallel parts by the threads of an arena.
template <class F>
decltype(auto) run_in(tbb::task_arena& arena, const F& f) {
  return arena.execute(f);
}

/// The same, but by TBB's own threads alone, of which there is one less than cores; this one waits.
template <class F>
void run_beside(tbb::task_arena& arena, const F& f) {
  std::binary_semaphore over(0);
  arena.enqueue([&] {
    f();
    over.release();
  });
  over.acquire();
}

/// f() and its parallel parts, while this thread takes up nothing else: for what holds a lock.
template <class F>
decltype(auto) run_alone(const F& f) {
  return tbb::this_task_arena::isolate(f);
}

#endif

/// Loops of all arenas together have so many threads at most, of which one is their caller's, while
/// this lives.
class ThreadLimit {
 public:
  /// threads   0: as many as there are cores
  explicit ThreadLimit(u32 threads)
      : control_(tbb::global_control::max_allowed_parallelism,
                 threads > 0 ? threads : std::max(1u, std::thread::hardware_concurrency())) {}

 private:
  tbb::global_control control_;
};

/// f(i) for each i below `count`, in any order.
template <class Index, class F>
void parallel_for(Index count, const F& f) {
  parallel_ranges(count, Index(1), [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) f(i);
  });
}

}  // namespace heliograph
