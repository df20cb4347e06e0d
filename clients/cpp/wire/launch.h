// A daemon that lives as long as its client. Called by launch().
#pragma once

#include <memory>
#include <string>

#include "heliograph/client.h"
#include "heliograph/error.h"

namespace heliograph::client::wire {

/// Owns: the process, its socket's folder, the thread that reads its log. The daemon watches this
/// process by pidfd and ends with it.
class PrivateDaemon {
 public:
  /// Starts it and waits until it listens. Throws kUnavailable with its last lines.
  explicit PrivateDaemon(const LaunchOptions& options);
  ~PrivateDaemon();
  PrivateDaemon(const PrivateDaemon&) = delete;
  PrivateDaemon& operator=(const PrivateDaemon&) = delete;

  [[nodiscard]] const std::string& address() const;  // "unix:///path"
  bool is_dead();
  /// Error that states how the daemon ended, where it does so within `patience` seconds: exit code
  /// and last lines.
  ClientError death(const std::string& message, double patience = 2);
  /// Kills a daemon that has no client yet, with its children.
  void give_up();
  /// SIGTERM, after 5 s SIGKILL.
  void stop();

 private:
  struct Process;
  std::unique_ptr<Process> process_;
};

}  // namespace heliograph::client::wire
