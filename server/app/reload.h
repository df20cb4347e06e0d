// Keys and identities that change while the daemon runs. Made and started by lifecycle.cpp.
#pragma once

#include "server/access/secret_file.h"
#include "server/calls/daemon.h"
#include "server/net/tls.h"

namespace heliograph::server {

/// Owns: the watches of the files. Thread: the loop's, once it is started.
class Reload {
 public:
  /// Made before the files are read first: changes count from now on.
  explicit Reload(const Config& config);
  /// `tls`: null without TLS. When a file is wrong, what held goes on holding and the log says why.
  void start(Daemon& daemon, Tls* tls);

 private:
  FileWatch tenants_;
  FileWatch tls_;
};

/// From now on the kernel writes no memory of this process to a core file and lets no process of
/// the same user read it.
void hide_memory();

}  // namespace heliograph::server
