// Reloads keys and identities while the daemon runs. Made and started by lifecycle.cpp.
#pragma once

#include "server/access/secret_file.h"
#include "server/calls/daemon.h"
#include "server/net/tls.h"

namespace heliograph::server {

/// Owns: the watches of the files. Thread: the loop's, once started.
class Reload {
 public:
  /// Construct before the files are first read: later changes are noticed.
  explicit Reload(const Config& config);
  /// tls   null without TLS
  /// When a changed file is wrong, the former content stays in force and the log states why.
  void start(Daemon& daemon, Tls* tls);

 private:
  FileWatch tenants_;
  FileWatch tls_;
};

/// Excludes this process's memory from core dumps, and denies other processes of the same user
/// access to it.
void hide_memory();

}  // namespace heliograph::server
