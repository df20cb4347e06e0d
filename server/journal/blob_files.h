// Arrays and snapshots of durable scenes as files, named by the SHA-256 of their bytes. Used by the
// journal.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>
#include <vector>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/journal/disk_room.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Handle of a file, which stays on the disk while any handle exists.
class BlobFile;
using BlobFilePtr = std::shared_ptr<BlobFile>;
/// Bytes, as they were put or read.
[[nodiscard]] u64 size_of(const BlobFile& file);

/// Where a file must find room: an edit in its owner's quota and on the disk; a snapshot on the
/// disk alone, since it makes room.
enum class Room : u8 { kEdit, kSnapshot };

/// The files of one tenant, in one folder. put() returns once the file and its folder are synced.
/// Files without a handle are removed by sweep(), and before the next one is stored. Thread: any.
class BlobFiles {
 public:
  struct Options {
    std::string folder;
    std::shared_ptr<Budget> disk;  // the tenant's quota
    DiskRoom& room;
    const std::atomic<bool>& may_remove;  // false: it is unknown which files the database refers to
  };
  explicit BlobFiles(Options options) : options_(std::move(options)) {}

  /// Stores bytes whose hash is known. RESOURCE_EXHAUSTED (the disk or the quota is full),
  /// UNAVAILABLE (the disk failed), each with a retry time.
  [[nodiscard]] Expected<BlobFilePtr> put(const std::string& hash, std::span<const std::byte> bytes,
                                          Room room);
  /// Returns the hash of a buffer, computed once per buffer.
  [[nodiscard]] std::string hash_of(const BufferPtr& buffer);
  /// Reads a file and keeps it from now on. INTERNAL when it is missing or does not match its name.
  [[nodiscard]] Expected<std::pair<BlobFilePtr, std::string>> read(const std::string& hash);
  /// Charges bytes stored elsewhere to the tenant's quota; fails as put() does.
  [[nodiscard]] Expected<Charge> charge(u64 bytes, Room room);
  /// Charges bytes that exist already, beyond any limit.
  [[nodiscard]] Charge count(u64 bytes) { return Charge::count(options_.disk, bytes); }
  /// Returns the handle of a file that has one; else null.
  [[nodiscard]] BlobFilePtr find(const std::string& hash);
  /// Removes files without a handle. strangers: also those that were never put or read.
  void sweep(bool strangers = false);

 private:
  [[nodiscard]] BlobFilePtr file(const std::string& hash);
  [[nodiscard]] std::string path(const std::string& hash) const;
  [[nodiscard]] Status write(const std::string& hash, std::span<const std::byte> bytes);
  void remove_strangers();

  /// Hashes of files whose last handle is gone.
  struct Dropped {
    std::mutex mutex;
    std::vector<std::string> hashes;
  };
  friend class BlobFile;

  const Options options_;
  const std::shared_ptr<Dropped> dropped_ = std::make_shared<Dropped>();
  std::mutex mutex_;
  std::map<std::string, std::weak_ptr<BlobFile>> files_;
  std::unordered_map<u64, std::pair<std::weak_ptr<const Buffer>, std::string>>
      hashes_;  // by serial
  std::size_t forget_at_ = 64;
};

/// Makes a folder, mode 0700, and syncs its parent. UNAVAILABLE when that fails.
[[nodiscard]] Status make_folder(const std::string& path);

}  // namespace heliograph::server
