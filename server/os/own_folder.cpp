// See own_folder.h.
#include "server/os/own_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>

namespace heliograph::server {

Expected<UniqueFd> open_own_folder(const std::string& folder, Others others, const char* flag) {
  UniqueFd fd(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  struct stat info{};
  if (!fd || ::fstat(fd.get(), &info) != 0)
    return fail(Code::kUnavailable, flag,
                fmt::format("cannot open the folder {}: {}", folder, std::strerror(errno)));
  const bool is_mine = info.st_uid == ::geteuid() || info.st_uid == 0;
  const bool may_read = others == Others::kMayRead;
  const bool is_open = may_read ? (info.st_mode & 0022) != 0 && (info.st_mode & S_ISVTX) == 0
                                : (info.st_mode & 0077) != 0;
  if (is_mine && !is_open) return fd;
  return fail(Code::kPermissionDenied, flag,
              fmt::format("the folder {} belongs to or is {} other users; choose one of yours or "
                          "run `chmod {}` on it",
                          folder, may_read ? "writable by" : "open to", may_read ? "go-w" : "700"));
}

}  // namespace heliograph::server
