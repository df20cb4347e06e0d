// Uploaded bytes of a tenant, found by their SHA-256 and stored once. Used by sessions
// (session_arrays.h).
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/os/hash.h"
#include "server/quota/budget.h"
#include "server/store/recent.h"

namespace heliograph::server {

struct BlobLimits {
  u64 bytes = 8ull << 30;  // of all live blobs and uploads, including those that scenes refer to
  u64 blob_bytes = 2ull << 30;     // of one blob
  u64 window_bytes = 16ull << 20;  // of an upload, charged ahead of their arrival
  u64 inline_bytes = 1u << 20;     // of one inline array
  RecentLimits recent = {};        // what a session keeps without references
};

/// An upload in progress. Charges the bytes received and a window ahead, so that announcing much
/// and sending nothing holds no more than that. Thread: one at a time.
class Incoming {
 public:
  /// Appends bytes. INVALID_ARGUMENT when there are more than announced, RESOURCE_EXHAUSTED when
  /// the room of the beginning is taken by others now, or the daemon's memory is nearly used up.
  [[nodiscard]] Status append(std::string_view chunk);
  /// Returns the bytes. INVALID_ARGUMENT when there are fewer than announced, or their hash
  /// differs.
  [[nodiscard]] Expected<BufferPtr> finish();
  [[nodiscard]] u64 size() const;
  /// Keeps `held` alive as long as this upload.
  void hold(std::shared_ptr<const void> held) { held_ = std::move(held); }

 private:
  friend class BlobStore;
  struct Storage;
  Incoming(std::shared_ptr<Storage> storage, std::string hash, u64 window)
      : storage_(std::move(storage)), hash_(std::move(hash)), window_(window) {}
  [[nodiscard]] Status charge(u64 bytes);
  std::shared_ptr<Storage> storage_;
  std::string hash_;  // 32 bytes; "" for an anonymous upload
  Sha256 digest_;
  u64 window_ = 0;
  u64 filled_ = 0;
  std::shared_ptr<const void> held_;
};

/// The live blobs by hash. Owns none: sessions (for a while) and scenes do, and a blob without
/// references is gone. Equal bytes are one Buffer, with one serial. Thread: any; one mutex, held
/// for a lookup.
class BlobStore {
 public:
  /// budget   of all blobs, other stores' too
  BlobStore(BlobLimits limits, std::shared_ptr<Budget> budget)
      : limits_(limits), budget_(std::move(budget)) {}
  explicit BlobStore(BlobLimits limits) : BlobStore(limits, make_budget(limits.bytes)) {}

  /// Bytes charged per blob beyond its content, so that many tiny blobs count too.
  static constexpr u64 kOverhead = 256;

  [[nodiscard]] static std::shared_ptr<Budget> make_budget(u64 bytes) {
    return std::make_shared<Budget>(
        bytes,
        Budget::RefusalText{"bytes", "remove what is not used any more, close other sessions",
                            "blob_store_bytes"});
  }

  /// Begins an upload of `size` bytes, which `budget` must have now. hash: 32 bytes that the
  /// content must hash to; "": any. INVALID_ARGUMENT, RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<Incoming> begin(std::string hash, u64 size,
                                         std::shared_ptr<Budget> budget) const;
  /// Charges bytes that an earlier daemon accepted, whatever the limits are now.
  [[nodiscard]] static BufferPtr restore(std::string bytes, std::shared_ptr<Budget> budget);
  /// Returns the blob of this hash, or null.
  [[nodiscard]] BufferPtr find(std::string_view hash) const;
  /// Adds a blob, unless one of its hash is alive. Returns the one that is kept.
  [[nodiscard]] BufferPtr put(const std::string& hash, BufferPtr buffer);

  [[nodiscard]] const BlobLimits& limits() const { return limits_; }
  /// Returns the budget of blobs.
  [[nodiscard]] const std::shared_ptr<Budget>& budget() const { return budget_; }

 private:
  void sweep();  // forgets hashes of expired blobs; under mutex_

  const BlobLimits limits_;
  const std::shared_ptr<Budget> budget_;
  mutable std::mutex mutex_;
  std::map<std::string, std::weak_ptr<const Buffer>, std::less<>> blobs_;
  std::size_t sweep_at_ = 64;
};

}  // namespace heliograph::server
