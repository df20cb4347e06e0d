// Lanes that close what waits. See closer.h.
#include "server/os/closer.h"

#include <sys/socket.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <system_error>
#include <thread>

namespace heliograph::server {

struct Closer::State {
  explicit State(Limits given) : limits(given) {}
  const Limits limits;
  std::mutex mutex;
  std::condition_variable ready;
  std::deque<UniqueFd> waiting;
  u32 lanes = 0;
  u32 idle = 0;  // of these, those that wait for work
  bool is_over = false;
};

Closer::Closer(Limits limits) : state_(std::make_shared<State>(limits)) {}

Closer::~Closer() {
  const std::lock_guard lock(state_->mutex);
  state_->is_over = true;
  state_->ready.notify_all();
}

void Closer::close(UniqueFd fd) {
  const std::lock_guard lock(state_->mutex);
  state_->waiting.push_back(std::move(fd));
  if (state_->idle >= state_->waiting.size()) return state_->ready.notify_one();
  if (state_->lanes == state_->limits.lanes) return;
  try {
    std::thread([state = state_] { work(state); }).detach();
    ++state_->lanes;
  } catch (const std::system_error&) {
    // It waits for a lane that is there, or for the next call's attempt.
  }
}

bool Closer::is_full() const { return open() >= state_->limits.lanes + state_->limits.waiting; }

u32 Closer::open() const {
  const std::lock_guard lock(state_->mutex);
  return u32(state_->waiting.size()) + state_->lanes - state_->idle;
}

void Closer::work(const std::shared_ptr<State>& state) {
  std::unique_lock lock(state->mutex);
  while (true) {
    ++state->idle;
    state->ready.wait(lock, [&] { return state->is_over || !state->waiting.empty(); });
    --state->idle;
    if (state->waiting.empty()) return;
    UniqueFd fd = std::move(state->waiting.front());
    state->waiting.pop_front();
    lock.unlock();
    const linger none{};  // what its sender set would hold this lane; no socket: refused
    ::setsockopt(fd.get(), SOL_SOCKET, SO_LINGER, &none, sizeof none);
    fd.reset();
    lock.lock();
  }
}

}  // namespace heliograph::server
