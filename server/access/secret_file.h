// Files that hold keys and identities: readable by few, and read again when they change.
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
/// secrets are). PERMISSION_DENIED when others may read or write it; the error is at `flag`.
[[nodiscard]] Expected<std::string> read_secret(const std::string& path, const char* flag);
/// The same for a file that everybody may read and nobody else may write.
[[nodiscard]] Expected<std::string> read_trusted(const std::string& path, const char* flag);

/// Says when files have changed and were then left alone for one look, so that nobody reads them
/// half written. Thread: the loop's, once it is started.
class FileWatch {
 public:
  static constexpr auto kLook = std::chrono::milliseconds(200);

  /// Changes count from now on.
  explicit FileWatch(std::vector<std::string> paths);
  void start(EventLoop& loop, std::function<void()> changed);

 private:
  [[nodiscard]] std::string look() const;
  void again();

  const std::vector<std::string> paths_;
  std::string known_;  // what look() said when they were read last
  std::string last_;
  EventLoop* loop_ = nullptr;
  std::function<void()> changed_;
  std::shared_ptr<int> alive_ = std::make_shared<int>(0);  // the timer checks it
};

}  // namespace heliograph::server
