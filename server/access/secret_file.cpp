// See secret_file.h.
#include "server/access/secret_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstring>

#include "server/os/unique_fd.h"

namespace heliograph::server {
namespace {

constexpr off_t kMaxBytes = 1 << 20;

/// secret   others may not even read it
Status check_owner(const struct stat& info, bool secret) {
  const bool is_roots = info.st_uid == 0;
  if (!is_roots && info.st_uid != ::geteuid())
    return fail(Code::kPermissionDenied, "", "belongs to another user; run `chown` on it");
  const mode_t others = secret ? (is_roots ? 0037 : 0077) : 0022;
  if ((info.st_mode & others) == 0) return {};
  return fail(Code::kPermissionDenied, "",
              secret ? "may be read or written by other users; run `chmod 600` on it"
                     : "may be written by other users; run `chmod go-w` on it");
}

Expected<std::string> read_checked(const std::string& path, bool secret) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
  struct stat info{};
  if (!fd || ::fstat(fd.get(), &info) != 0)
    return fail(Code::kInvalidArgument, "",
                fmt::format("cannot be read: {}", std::strerror(errno)));
  if (!S_ISREG(info.st_mode) || info.st_size > kMaxBytes)
    return fail(Code::kInvalidArgument, "", "is no file, or has more than 1 MiB");
  HELIO_TRY(check_owner(info, secret));
  std::string text(std::size_t(info.st_size), '\0');
  const ssize_t size = ::read(fd.get(), text.data(), text.size());
  text.resize(size > 0 ? std::size_t(size) : 0);
  return text;
}

Expected<std::string> read_named(const std::string& path, const char* flag, bool secret) {
  auto text = read_checked(path, secret);
  if (text) return text;
  Error error = std::move(text).error();
  error.message = path + " " + error.message;
  error.where = flag;
  return std::unexpected(std::move(error));
}

}  // namespace

Expected<std::string> read_secret(const std::string& path, const char* flag) {
  return read_named(path, flag, true);
}

Expected<std::string> read_trusted(const std::string& path, const char* flag) {
  return read_named(path, flag, false);
}

FileWatch::FileWatch(std::vector<std::string> paths)
    : paths_(std::move(paths)), known_(stamp()), last_(known_) {}

void FileWatch::start(EventLoop& loop, std::function<void()> changed) {
  loop_ = &loop;
  changed_ = std::move(changed);
  if (!paths_.empty()) again();
}

std::string FileWatch::stamp() const {
  std::string seen;
  for (const std::string& path : paths_) {
    struct stat info{};
    if (::stat(path.c_str(), &info) != 0) info = {};
    seen += fmt::format("{} {} {} {}.{} {}.{};", info.st_dev, info.st_ino, info.st_size,
                        info.st_mtim.tv_sec, info.st_mtim.tv_nsec, info.st_ctim.tv_sec,
                        info.st_ctim.tv_nsec);
  }
  return seen;
}

void FileWatch::again() {
  loop_->after(kInterval, [this, alive = std::weak_ptr(alive_)] {
    if (alive.expired()) return;
    std::string seen = stamp();
    if (seen != known_ && seen == last_) {
      known_ = seen;
      changed_();
    }
    last_ = std::move(seen);
    again();
  });
}

}  // namespace heliograph::server
