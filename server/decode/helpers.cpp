#include "server/decode/helpers.h"

#include <thread>

namespace heliograph::server {

void Helpers::start(unsigned count) {
  count_ = count;
  for (unsigned i = 0; i < count; ++i) std::thread([this] { help(); }).detach();
}

void Helpers::run(const std::function<void()>& work) {
  {
    const std::lock_guard lock(mutex_);
    work_ = &work;
    busy_ = count_;
    ++round_;
  }
  changed_.notify_all();
  work();
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return busy_ == 0; });
}

void Helpers::help() {
  unsigned seen = 0;
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return round_ != seen; });
    seen = round_;
    const auto* work = work_;
    lock.unlock();
    (*work)();
    lock.lock();
    if (--busy_ == 0) changed_.notify_all();
  }
}

}  // namespace heliograph::server
