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

/// A file that is on the disk for as long as somebody holds this.
class BlobFile;
using BlobFilePtr = std::shared_ptr<BlobFile>;
/// Bytes, as they were put or read.
[[nodiscard]] u64 size_of(const BlobFile& file);

/// What a file must find room for: an edit in its owner's quota and on the disk; a snapshot on the
/// disk alone, since it makes room.
enum class Room : u8 { kEdit, kSnapshot };

/// The files of one tenant, in one folder. A file is whole and synced, its folder too, before put()
/// returns; files that nobody holds any more are removed by sweep(), and before the next one is
/// stored. Thread: any.
class BlobFiles {
 public:
  struct Options {
    std::string folder;
    std::shared_ptr<Budget> disk;  // of the tenant
    DiskRoom& room;
    const std::atomic<bool>& may_remove;  // false: it is not known what the database refers to
  };
  explicit BlobFiles(Options options) : options_(std::move(options)) {}

  /// Stores bytes whose hash is known.
  /// Fails with RESOURCE_EXHAUSTED (the disk or the quota is full), UNAVAILABLE (the disk failed);
  /// then there is a retry time.
  [[nodiscard]] Expected<BlobFilePtr> put(const std::string& hash, std::span<const std::byte> bytes,
                                          Room room);
  /// The hash of a buffer, computed once for each.
  [[nodiscard]] std::string hash_of(const BufferPtr& buffer);
  /// The bytes of a file, held from now on; INTERNAL when it is missing or others than its name
  /// says.
  [[nodiscard]] Expected<std::pair<BlobFilePtr, std::string>> read(const std::string& hash);
  /// The tenant's share of the disk for bytes that are stored elsewhere; fails as put() does.
  [[nodiscard]] Expected<Charge> charge(u64 bytes, Room room);
  /// The same for what is there already.
  [[nodiscard]] Charge count(u64 bytes) { return Charge::count(options_.disk, bytes); }
  /// One that somebody holds; else null.
  [[nodiscard]] BlobFilePtr find(const std::string& hash);
  /// Removes files that nobody holds. `strangers`: those that were never put or read, too.
  void sweep(bool strangers = false);

 private:
  [[nodiscard]] BlobFilePtr file(const std::string& hash);
  [[nodiscard]] std::string path(const std::string& hash) const;
  [[nodiscard]] Status write(const std::string& hash, std::span<const std::byte> bytes);
  void remove_strangers();

  /// Hashes of files whose last holder is gone.
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
