// See socket_files.h.
#include "server/net/socket_files.h"

#include <sys/stat.h>
#include <unistd.h>

namespace heliograph::server {

SocketFiles::~SocketFiles() {
  for (const File& file : files_) {
    struct stat info{};
    const bool is_ours = ::lstat(file.path.c_str(), &info) == 0 && info.st_dev == file.device &&
                         info.st_ino == file.inode;
    if (is_ours) ::unlink(file.path.c_str());
  }
  if (!folder_.empty()) ::rmdir(folder_.c_str());
}

void SocketFiles::add(const std::string& path) {
  struct stat info{};
  if (::lstat(path.c_str(), &info) == 0) files_.push_back({path, info.st_dev, info.st_ino});
}

}  // namespace heliograph::server
