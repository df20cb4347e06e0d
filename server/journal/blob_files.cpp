// Whole files or none. See blob_files.h.
#include "server/journal/blob_files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>

#include "server/convert/fields.h"
#include "server/os/hash.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {
namespace {

constexpr const char* kTemporary = ".new";

constexpr double kRetrySeconds = 1;
constexpr u64 kFileBytes = 4096;  // overhead of a file on the disk, at most

std::unexpected<Error> failed(const std::string& path, const char* what) {
  const int why = errno;
  const std::string name = std::filesystem::path(path).filename().string();
  const bool is_full = why == ENOSPC || why == EDQUOT || why == EFBIG;
  Error error{.code = is_full ? Code::kResourceExhausted : Code::kUnavailable,
              .message = is_full
                             ? fmt::format("the disk of the state directory is full ({} of {}); "
                                           "make room, or retry later",
                                           what, name)
                             : fmt::format("the state directory failed: {} of {}: {}", what, name,
                                           std::strerror(why)),
              .where = ""};
  error.retry_seconds = kRetrySeconds;
  return std::unexpected(std::move(error));
}

Status sync_folder(const std::string& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (fd.get() < 0 || ::fsync(fd.get()) != 0) return failed(path, "fsync");
  return {};
}

Status write_file(const std::string& path, std::span<const std::byte> bytes) {
  const UniqueFd fd(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600));
  if (fd.get() < 0) return failed(path, "creation");
  while (!bytes.empty()) {
    const ssize_t written = ::write(fd.get(), bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return failed(path, "write");
    bytes = bytes.subspan(std::size_t(written));
  }
  if (::fsync(fd.get()) != 0) return failed(path, "fsync");
  return {};
}

/// Returns nothing when the file is missing or unreadable.
std::optional<std::string> read_file(const std::string& path) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat status{};
  if (!fd || ::fstat(fd.get(), &status) != 0) return std::nullopt;
  std::string bytes(std::size_t(status.st_size), '\0');
  std::size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t count = ::read(fd.get(), bytes.data() + filled, bytes.size() - filled);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return std::nullopt;
    filled += std::size_t(count);
  }
  return bytes;
}

}  // namespace

class BlobFile {
 public:
  BlobFile(std::string hash, std::shared_ptr<BlobFiles::Dropped> dropped)
      : hash_(std::move(hash)), dropped_(std::move(dropped)) {}
  BlobFile(const BlobFile&) = delete;
  ~BlobFile() {
    const std::lock_guard lock(dropped_->mutex);
    dropped_->hashes.push_back(std::move(hash_));
  }

  std::mutex mutex;
  bool is_there = false;  // guarded by mutex, like charge
  Charge charge;
  std::atomic<u64> size = 0;

 private:
  std::string hash_;
  const std::shared_ptr<BlobFiles::Dropped> dropped_;
};

u64 size_of(const BlobFile& file) { return file.size; }

Status make_folder(const std::string& path) {
  if (::mkdir(path.c_str(), 0700) == 0)
    return sync_folder(std::filesystem::absolute(path).parent_path().string());
  if (errno != EEXIST) return failed(path, "creation");
  return {};
}

std::string BlobFiles::path(const std::string& hash) const {
  return options_.folder + "/" + hex(hash);
}

BlobFilePtr BlobFiles::file(const std::string& hash) {
  const std::lock_guard lock(mutex_);
  auto& known = files_[hash];
  auto file = known.lock();
  if (!file) known = file = std::make_shared<BlobFile>(hash, dropped_);
  return file;
}

Status BlobFiles::write(const std::string& hash, std::span<const std::byte> bytes) {
  HELIO_TRY(make_folder(options_.folder));
  const std::string name = path(hash), temporary = name + kTemporary;
  Status written = write_file(temporary, bytes);
  if (written && ::rename(temporary.c_str(), name.c_str()) != 0) written = failed(name, "rename");
  if (!written) {
    ::unlink(temporary.c_str());
    return written;
  }
  return sync_folder(options_.folder);
}

BlobFilePtr BlobFiles::find(const std::string& hash) {
  const std::lock_guard lock(mutex_);
  const auto known = files_.find(hash);
  return known == files_.end() ? nullptr : known->second.lock();
}

Expected<Charge> BlobFiles::charge(u64 bytes, Room room) {
  if (room == Room::kSnapshot) {
    HELIO_TRY(options_.room.admit_snapshot(bytes));
    return count(bytes);
  }
  auto charge = Charge::take(options_.disk, bytes);
  if (!charge) {
    charge.error().retry_seconds = kRetrySeconds;  // superseded files are removed meanwhile
    return charge;
  }
  HELIO_TRY(options_.room.admit(bytes, options_.disk->used() - bytes));
  return charge;
}

Expected<BlobFilePtr> BlobFiles::put(const std::string& hash, std::span<const std::byte> bytes,
                                     Room room) {
  sweep();
  BlobFilePtr held = file(hash);
  const std::lock_guard lock(held->mutex);
  if (held->is_there) return held;
  auto charged = charge(bytes.size() + kFileBytes, room);
  if (!charged) return std::unexpected(std::move(charged).error());
  HELIO_TRY(write(hash, bytes));
  held->charge = std::move(*charged);
  held->is_there = true;
  held->size = bytes.size();
  return held;
}

Expected<std::pair<BlobFilePtr, std::string>> BlobFiles::read(const std::string& hash) {
  BlobFilePtr held = file(hash);
  const std::lock_guard lock(held->mutex);
  auto bytes = read_file(path(hash));
  if (!bytes) return fail(Code::kInternal, "", fmt::format("the file {} is missing", path(hash)));
  if (sha256(*bytes) != hash)
    return fail(Code::kInternal, "",
                fmt::format("the file {} is damaged: its bytes have another SHA-256", path(hash)));
  if (!held->is_there) held->charge = count(bytes->size() + kFileBytes);
  held->is_there = true;
  held->size = bytes->size();
  return std::pair(std::move(held), std::move(*bytes));
}

std::string BlobFiles::hash_of(const BufferPtr& buffer) {
  {
    const std::lock_guard lock(mutex_);
    const auto known = hashes_.find(buffer->serial());
    if (known != hashes_.end()) return known->second.second;
  }
  std::string hash = sha256(buffer->bytes());
  const std::lock_guard lock(mutex_);
  hashes_[buffer->serial()] = {buffer, hash};
  if (hashes_.size() >= forget_at_) {
    std::erase_if(hashes_, [](const auto& known) { return known.second.first.expired(); });
    forget_at_ = std::max<std::size_t>(64, 2 * hashes_.size());
  }
  return hash;
}

void BlobFiles::sweep(bool strangers) {
  std::vector<std::string> dropped;
  if (options_.may_remove) {
    const std::lock_guard lock(dropped_->mutex);
    dropped.swap(dropped_->hashes);
  }
  if (!dropped.empty()) {
    const std::lock_guard lock(mutex_);
    for (const std::string& hash : dropped) {
      const auto known = files_.find(hash);
      if (known == files_.end() || !known->second.expired()) continue;
      ::unlink(path(hash).c_str());
      files_.erase(known);
    }
  }
  if (strangers) remove_strangers();
}

void BlobFiles::remove_strangers() {
  std::map<std::string, bool> mine;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [hash, file] : files_) mine.emplace(hex(hash), true);
  }
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(options_.folder, ignored))
    if (!mine.contains(entry.path().filename().string()))
      std::filesystem::remove(entry.path(), ignored);
}

}  // namespace heliograph::server
