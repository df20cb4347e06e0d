// Arrays and snapshots of durable scenes as files, named by the SHA-256 of their bytes. Used by the
// journal.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <unordered_map>

#include "renderer/base/array.h"
#include "renderer/base/error.h"

namespace heliograph::server {

/// A file that is on the disk for as long as somebody holds this.
class BlobFile;
using BlobFilePtr = std::shared_ptr<BlobFile>;
/// Bytes, as they were put or read.
[[nodiscard]] u64 size_of(const BlobFile& file);

/// The files of one tenant, in one folder. A file is whole and synced, its folder too, before put()
/// returns; files that nobody holds any more are removed by sweep(). Thread: any.
class BlobFiles {
 public:
  explicit BlobFiles(std::string folder) : folder_(std::move(folder)) {}

  /// Stores bytes whose hash is known.
  /// Fails with RESOURCE_EXHAUSTED (the disk is full), UNAVAILABLE (it failed).
  [[nodiscard]] Expected<BlobFilePtr> put(const std::string& hash,
                                          std::span<const std::byte> bytes);
  /// The hash of a buffer, computed once for each.
  [[nodiscard]] std::string hash_of(const BufferPtr& buffer);
  /// The bytes of a file, held from now on; INTERNAL when it is missing or others than its name
  /// says.
  [[nodiscard]] Expected<std::pair<BlobFilePtr, std::string>> read(const std::string& hash);
  /// Removes files that nobody holds. `strangers`: those that were never put or read, too.
  void sweep(bool strangers = false);

 private:
  [[nodiscard]] BlobFilePtr file(const std::string& hash);
  [[nodiscard]] std::string path(const std::string& hash) const;
  [[nodiscard]] Status write(const std::string& hash, std::span<const std::byte> bytes);
  void remove_strangers();

  const std::string folder_;
  std::mutex mutex_;
  std::map<std::string, std::weak_ptr<BlobFile>> files_;
  std::unordered_map<u64, std::pair<std::weak_ptr<const Buffer>, std::string>>
      hashes_;  // by serial
};

/// Makes a folder, mode 0700, and syncs its parent. UNAVAILABLE when that fails.
[[nodiscard]] Status make_folder(const std::string& path);

}  // namespace heliograph::server
