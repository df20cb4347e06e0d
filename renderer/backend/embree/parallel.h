// Loops over the cores, by TBB: the one place that names it, and that tells ThreadSanitizer what
// TBB, which is built without it, orders.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace heliograph::embree {

/// What was done before a parallel part is seen in it, and what was done in it is seen after it.
/// Lives as long as the part.
class Ordered {
 public:
#ifdef __SANITIZE_THREAD__
  Ordered() { __tsan_release(&begun_); }
  ~Ordered() { __tsan_acquire(&ended_); }
  Ordered(const Ordered&) = delete;

  /// A piece of the part, by whatever thread.
  template <class F>
  decltype(auto) run(const F& f) {
    __tsan_acquire(&begun_);
    const Release at_end{&ended_};
    return f();
  }

 private:
  struct Release {
    char* at;
    ~Release() { __tsan_release(at); }
  };
  char begun_ = 0, ended_ = 0;
#else
  template <class F>
  decltype(auto) run(const F& f) {
    return f();
  }
#endif
};

/// f(begin, end) for pieces, of `grain` or more, of what is below `count`, in any order.
template <class Index, class F>
void parallel_ranges(Index count, Index grain, const F& f) {
  Ordered ordered;
  tbb::parallel_for(tbb::blocked_range<Index>(0, count, grain), [&](const auto& range) {
    ordered.run([&] { f(range.begin(), range.end()); });
  });
}

/// f(i) for each i below `count`, in any order.
template <class Index, class F>
void parallel_for(Index count, const F& f) {
  parallel_ranges(count, Index(1), [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) f(i);
  });
}

/// Both, in any order.
template <class F, class G>
void parallel_invoke(const F& f, const G& g) {
  Ordered ordered;
  tbb::parallel_invoke([&] { ordered.run(f); }, [&] { ordered.run(g); });
}

/// f() and its parallel parts by the threads of an arena.
template <class F>
decltype(auto) run_in(tbb::task_arena& arena, const F& f) {
  Ordered ordered;
  return arena.execute([&]() -> decltype(auto) { return ordered.run(f); });
}

}  // namespace heliograph::embree
