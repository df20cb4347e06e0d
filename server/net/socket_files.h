// Socket files, removed when the daemon ends. Used by lifecycle.cpp.
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace heliograph::server {

/// Removes the files that add() named, unless another daemon has replaced them meanwhile.
class SocketFiles {
 public:
  SocketFiles() = default;
  SocketFiles(const SocketFiles&) = delete;
  SocketFiles& operator=(const SocketFiles&) = delete;
  ~SocketFiles();

  void add(const std::string& path);
  /// Also removes this folder, if it is empty by then.
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
