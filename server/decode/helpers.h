// The threads of a decode child. They are there before its sandbox is closed, which lets no thread
// be started.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>

namespace heliograph::server {

/// Lives as long as its process, which ends without a word to it. One thread runs work at a time.
class Helpers {
 public:
  void start(unsigned count);
  /// Calls `work` here and in every helper, and returns when all have.
  void run(const std::function<void()>& work);

 private:
  void help();
  std::mutex mutex_;
  std::condition_variable changed_;
  const std::function<void()>* work_ = nullptr;
  unsigned round_ = 0;  // how often there was work
  unsigned count_ = 0;  // of helpers
  unsigned busy_ = 0;   // that have not ended this round
};

}  // namespace heliograph::server
