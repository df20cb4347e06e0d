// See log_writer.h.
#include "server/os/log_writer.h"

#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <string_view>
#include <thread>

namespace heliograph::server {
namespace {

constexpr auto kFlush = std::chrono::seconds(1);

/// Writes all of a text. False when the reader has closed the pipe.
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

std::shared_ptr<LogWriter> LogWriter::start(int fd, u64 bytes, DroppedLine dropped) {
  std::shared_ptr<LogWriter> made(new LogWriter(fd, bytes, std::move(dropped)));
  std::thread([made] { made->work(); }).detach();
  return made;
}

void LogWriter::close() {
  flush();
  const std::lock_guard lock(mutex_);
  is_over_ = true;
  changed_.notify_all();
}

void LogWriter::flush_() {
  std::unique_lock lock(mutex_, std::adopt_lock);
  changed_.wait_for(lock, kFlush,
                    [this] { return lines_.empty() && !is_writing_ && dropped_ == reported_; });
  lock.release();  // the caller holds and releases the mutex
}

void LogWriter::sink_it_(const spdlog::details::log_msg& message) {
  std::string line = format(message);
  if (line.size() > room_ - bytes_) {
    ++dropped_;
    return;
  }
  bytes_ += line.size();
  lines_.push_back(std::move(line));
  changed_.notify_all();
}

std::string LogWriter::format(const spdlog::details::log_msg& message) const {
  spdlog::memory_buf_t text;
  formatter_->format(message, text);
  return {text.data(), text.size()};
}

void LogWriter::lose() {
  const std::lock_guard lock(mutex_);
  ++dropped_;
  changed_.notify_all();
}

u64 LogWriter::dropped() {
  const std::lock_guard lock(mutex_);
  return dropped_;
}

double LogWriter::still_seconds() {
  const std::lock_guard lock(mutex_);
  if (!is_writing_) return 0;
  return std::chrono::duration<double>(Clock::now() - began_).count();
}

/// Returns the next text to write: the first line, or the notice of dropped lines; "": nothing.
std::string LogWriter::next() {
  if (lines_.empty() && dropped_ == reported_) return "";
  if (!lines_.empty()) return lines_.front();
  const std::string notice = dropped_line_(dropped_ - reported_);
  reported_ = dropped_;
  return format({"", spdlog::level::warn, notice});
}

void LogWriter::work() {
  std::unique_lock lock(mutex_);
  while (!is_over_) {
    const bool is_line = !lines_.empty();
    const std::string text = next();
    if (text.empty()) {
      changed_.wait(lock);
      continue;
    }
    is_writing_ = true;
    began_ = Clock::now();
    lock.unlock();
    const bool is_written = write_all(fd_, text);
    lock.lock();
    is_writing_ = false;
    if (is_line) {
      if (!is_written) reported_ = ++dropped_;  // the notice cannot be written either
      bytes_ -= text.size();
      lines_.pop_front();
    }
    changed_.notify_all();
  }
}

}  // namespace heliograph::server
