// The sockets in the file system, removed when the daemon ends. Used by lifecycle.cpp.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace heliograph::server {

/// Removes what add() named, unless another daemon put its own there meanwhile.
class SocketFiles {
 public:
  SocketFiles() = default;
  SocketFiles(const SocketFiles&) = delete;
  SocketFiles& operator=(const SocketFiles&) = delete;
  ~SocketFiles();

  void add(const std::string& path);
  /// The folder goes too, when it is empty then.
  void remove_folder(const std::string& path) { folder_ = path; }

 private:
  struct File {
    std::string path;
    dev_t device;
    ino_t inode;
  };
  std::vector<File> files_;
  std::string folder_;
};

}  // namespace heliograph::server
