// Threads that close queued descriptors. See closer.h.
#include "server/os/closer.h"

#include <sys/socket.h>

#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <system_error>
#include <thread>

namespace heliograph::server {

struct Closer::State {
  State(Limits given, Close how) : limits(given), close(std::move(how)) {}
  const Limits limits;
  const Close close;
  std::mutex mutex;
  std::condition_variable ready;
  struct Queue {
    std::deque<UniqueFd> waiting;
    bool is_closing = false;  // a thread closes one of this sender's
  };
  std::map<u64, Queue> queues;  // by sender; none is empty
  std::deque<u64> turns;        // senders with waiting descriptors, none being closed
  u32 open = 0;
  u32 lanes = 0;
  u32 idle = 0;  // idle threads
  bool is_over = false;
};

Closer::Closer(Limits limits, Close close)
    : state_(std::make_shared<State>(limits, std::move(close))) {}

Closer::~Closer() {
  const std::lock_guard lock(state_->mutex);
  state_->is_over = true;
  state_->ready.notify_all();
}

void Closer::close(UniqueFd fd, u64 sender) {
  const std::lock_guard lock(state_->mutex);
  State::Queue& queue = state_->queues[sender];
  queue.waiting.push_back(std::move(fd));
  ++state_->open;
  if (queue.waiting.size() == 1 && !queue.is_closing) state_->turns.push_back(sender);
  if (state_->idle >= state_->turns.size()) return state_->ready.notify_one();
  if (state_->lanes == state_->limits.lanes) return;
  try {
    std::thread([state = state_] { work(state); }).detach();
    ++state_->lanes;
  } catch (const std::system_error&) {
    // No thread could be made: an existing one, or the next call, takes it.
  }
}

bool Closer::is_full(u64 sender) const {
  const std::lock_guard lock(state_->mutex);
  const auto queue = state_->queues.find(sender);
  return queue != state_->queues.end() && queue->second.waiting.size() >= state_->limits.waiting;
}

bool Closer::is_full() const { return open() >= state_->limits.open; }

u32 Closer::open() const {
  const std::lock_guard lock(state_->mutex);
  return state_->open;
}

void Closer::close_now(UniqueFd fd) {
  // Replaces the sender's linger, which would block. Fails harmlessly for non-sockets.
  const linger none{};
  ::setsockopt(fd.get(), SOL_SOCKET, SO_LINGER, &none, sizeof none);
}

void Closer::work(const std::shared_ptr<State>& state) {
  std::unique_lock lock(state->mutex);
  while (true) {
    ++state->idle;
    state->ready.wait(lock, [&] { return state->is_over || !state->turns.empty(); });
    --state->idle;
    if (state->turns.empty()) return;
    const u64 sender = state->turns.front();
    state->turns.pop_front();
    State::Queue& queue = state->queues[sender];
    UniqueFd fd = std::move(queue.waiting.front());
    queue.waiting.pop_front();
    queue.is_closing = true;
    lock.unlock();
    state->close(std::move(fd));
    lock.lock();
    --state->open;
    queue.is_closing = false;
    if (queue.waiting.empty())
      state->queues.erase(sender);
    else
      state->turns.push_back(sender);
  }
}

}  // namespace heliograph::server
