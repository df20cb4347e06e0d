// Threads of a decode child, started before its sandbox is entered, which allows no new ones.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>

namespace heliograph::server {

/// Helper threads. Live as long as the process, which ends without joining them. Thread: one runs
/// work at a time.
class Helpers {
 public:
  void start(unsigned count);
  /// Calls `work` in this thread and in every helper; returns when all have returned.
  void run(const std::function<void()>& work);

 private:
  void help();
  std::mutex mutex_;
  std::condition_variable changed_;
  const std::function<void()>* work_ = nullptr;
  unsigned round_ = 0;  // number of the current round
  unsigned count_ = 0;  // helpers
  unsigned busy_ = 0;   // helpers that have not finished this round
};

}  // namespace heliograph::server
