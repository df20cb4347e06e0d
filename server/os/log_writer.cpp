// See log_writer.h.
#include "server/os/log_writer.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <string_view>
#include <thread>

namespace heliograph::server {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kFlush = std::chrono::seconds(1);

/// False when nobody can read it any more.
bool write_all(int fd, std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(fd, text.data(), text.size());
    if (written >= 0) {
      text.remove_prefix(std::size_t(written));
    } else if (errno == EAGAIN) {
      pollfd event{.fd = fd, .events = POLLOUT, .revents = 0};
      ::poll(&event, 1, -1);
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

}  // namespace

struct LogWriter::State {
  State(int file, u64 most, DroppedLine line)
      : fd(file), room(most), dropped_line(std::move(line)) {}
  const int fd;
  const u64 room;
  const DroppedLine dropped_line;
  mutable std::mutex mutex;
  std::condition_variable changed;
  std::deque<std::string> lines;  // the first one may be on its way
  u64 bytes = 0;                  // of these
  u64 dropped = 0;
  u64 told = 0;  // of the dropped ones
  Clock::time_point began;
  bool is_writing = false;
  bool is_over = false;

  /// What is written next: of `lines` the first, or how many were dropped; "": nothing. Under the
  /// mutex.
  [[nodiscard]] std::string next() {
    if (lines.empty() && dropped == told) return "";
    if (!lines.empty()) return lines.front();
    const u64 more = dropped - told;
    told = dropped;
    return dropped_line(more);
  }
};

LogWriter::LogWriter(int fd, u64 bytes, DroppedLine dropped)
    : state_(std::make_shared<State>(fd, bytes, std::move(dropped))) {
  std::thread([state = state_] { work(state); }).detach();
}

LogWriter::~LogWriter() {
  flush();
  const std::lock_guard lock(state_->mutex);
  state_->is_over = true;
  state_->changed.notify_all();
}

void LogWriter::flush() const {
  std::unique_lock lock(state_->mutex);
  state_->changed.wait_for(lock, kFlush, [this] {
    return state_->lines.empty() && !state_->is_writing && state_->dropped == state_->told;
  });
}

void LogWriter::write(std::string line) {
  {
    const std::lock_guard lock(state_->mutex);
    if (line.size() > state_->room - state_->bytes) {
      ++state_->dropped;
      return;
    }
    state_->bytes += line.size();
    state_->lines.push_back(std::move(line));
  }
  state_->changed.notify_all();
}

u64 LogWriter::dropped() const {
  const std::lock_guard lock(state_->mutex);
  return state_->dropped;
}

double LogWriter::still_seconds() const {
  const std::lock_guard lock(state_->mutex);
  if (!state_->is_writing) return 0;
  return std::chrono::duration<double>(Clock::now() - state_->began).count();
}

void LogWriter::work(const std::shared_ptr<State>& state) {
  std::unique_lock lock(state->mutex);
  while (true) {
    if (state->is_over) return;
    const bool is_line = !state->lines.empty();
    const std::string text = state->next();
    if (text.empty()) {
      state->changed.wait(lock);
      continue;
    }
    state->is_writing = true;
    state->began = Clock::now();
    lock.unlock();
    const bool is_written = write_all(state->fd, text);
    lock.lock();
    state->is_writing = false;
    if (is_line) {
      if (!is_written) state->told = ++state->dropped;  // nobody can be told
      state->bytes -= text.size();
      state->lines.pop_front();
    }
    state->changed.notify_all();
  }
}

}  // namespace heliograph::server
