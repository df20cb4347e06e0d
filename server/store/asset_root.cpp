// Opening files beneath the asset root. Called by DecodeAsset.
#include "server/store/asset_root.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/openat2.h>
#include <sys/stat.h>
#include <sys/syscall.h>

#include <cerrno>
#include <cstring>

namespace heliograph::server {
namespace {

constexpr const char* kField = "server_path";

UniqueFd open_beneath(int folder, const std::string& path) {
  open_how how{};
  how.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY;
  how.resolve = RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS | RESOLVE_NO_MAGICLINKS;
  return UniqueFd(int(::syscall(SYS_openat2, folder, path.c_str(), &how, sizeof how)));
}

}  // namespace

Expected<BufferPtr> AssetFile::read() const {
  auto bytes = std::make_shared<std::vector<std::byte>>(size);
  u64 done = 0;
  while (done < size) {
    const ssize_t got = ::read(fd.get(), bytes->data() + done, size - done);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return fail(Code::kUnavailable, kField, "the file changed while it was read");
    done += u64(got);
  }
  return std::make_shared<const Buffer>(bytes, std::span(*bytes));
}

Expected<AssetRoot> AssetRoot::open(const std::string& folder) {
  UniqueFd fd(::open(folder.c_str(), O_PATH | O_DIRECTORY | O_CLOEXEC));
  if (!fd)
    return fail(Code::kInvalidArgument, "--asset-root",
                "cannot open the folder " + folder + ": " + std::strerror(errno));
  return AssetRoot(std::move(fd));
}

Expected<AssetFile> AssetRoot::find(const std::string& path, u64 max_bytes) const {
  if (!folder_)
    return fail(Code::kPermissionDenied, kField,
                "this daemon reads no files of its machine; start it with --asset-root, or upload "
                "the file");
  const bool has_nul = path.find('\0') != std::string::npos;
  UniqueFd fd = has_nul ? UniqueFd() : open_beneath(folder_.get(), path);
  struct stat info{};
  if (!fd || ::fstat(fd.get(), &info) != 0 || !S_ISREG(info.st_mode) || info.st_nlink > 1)
    return fail(Code::kNotFound, kField,
                "names no regular file beneath the asset root; links are not followed");
  if (u64(info.st_size) > max_bytes) {
    Error error{.code = Code::kResourceExhausted,
                .message = fmt::format("the file has {} bytes; {} are allowed (limit blob_bytes)",
                                       info.st_size, max_bytes),
                .where = kField};
    error.limit = "blob_bytes";
    error.needed = u64(info.st_size);
    error.available = max_bytes;
    return std::unexpected(std::move(error));
  }
  return AssetFile{.fd = std::move(fd), .size = u64(info.st_size)};
}

}  // namespace heliograph::server
