// Files with keys and identities: readable by few, read again when they change.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/error.h"
#include "server/os/event_loop.h"

namespace heliograph::server {

/// Reads a file that only the daemon's user may read, or that root shares with a group (as mounted
/// secrets are). PERMISSION_DENIED, at `flag`, when others may read or write it.
[[nodiscard]] Expected<std::string> read_secret(const std::string& path, const char* flag);
/// Reads a file that anyone may read and no other user may write. PERMISSION_DENIED, at `flag`,
/// otherwise.
[[nodiscard]] Expected<std::string> read_trusted(const std::string& path, const char* flag);

/// Watches files by polling their stat(). Reports a change once it has been stable for one
/// interval, so that no half-written file is read. Thread: the loop's, once started.
class FileWatch {
 public:
  static constexpr auto kInterval = std::chrono::milliseconds(200);

  /// Takes the files' present state as the base of comparison.
  explicit FileWatch(std::vector<std::string> paths);
  void start(EventLoop& loop, std::function<void()> changed);

 private:
  [[nodiscard]] std::string stamp() const;
  void again();

  const std::vector<std::string> paths_;
  std::string known_;  // stamp() when the files were last read
  std::string last_;
  EventLoop* loop_ = nullptr;
  std::function<void()> changed_;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // the timer checks it
};

}  // namespace heliograph::server
