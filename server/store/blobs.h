// Uploaded bytes of a tenant, found by their SHA-256 and stored once. Used by sessions
// (holdings.h).
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
  u64 bytes = 8ull << 30;  // of all blobs and uploads alive, those that scenes refer to included
  u64 blob_bytes = 2ull << 30;     // of one
  u64 window_bytes = 16ull << 20;  // of an upload, charged before they come
  u64 inline_bytes = 1u << 20;     // of one inline array
  RecentLimits recent = {};        // what a session keeps that nothing refers to
};

/// Bytes on their way in. What came is charged, and a window ahead of it: who announces much and
/// sends nothing holds no more than that.
/// Thread: one at a time.
class Incoming {
 public:
  /// INVALID_ARGUMENT when more comes than was announced, RESOURCE_EXHAUSTED when the room that was
  /// there at the beginning is others' now, or when the daemon's memory is nearly used up.
  [[nodiscard]] Status append(std::string_view chunk);
  /// The bytes; INVALID_ARGUMENT when fewer came than announced, or others than `hash` names.
  [[nodiscard]] Expected<BufferPtr> finish();
  [[nodiscard]] u64 size() const;
  /// Holds this as long as the bytes are on their way.
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

/// The blobs alive, by hash. It owns none: sessions (for a while) and scenes do, and what nobody
/// refers to any more is gone. Equal bytes are one Buffer, so that they have one serial. Thread:
/// any; one mutex, held for a look-up.
class BlobStore {
 public:
  /// `budget`: of all blobs, other stores' too.
  BlobStore(BlobLimits limits, std::shared_ptr<Budget> budget)
      : limits_(limits), budget_(std::move(budget)) {}
  explicit BlobStore(BlobLimits limits) : BlobStore(limits, make_budget(limits.bytes)) {}

  /// What a blob costs besides its bytes, so that many tiny ones count too.
  static constexpr u64 kOverhead = 256;

  [[nodiscard]] static std::shared_ptr<Budget> make_budget(u64 bytes) {
    return std::make_shared<Budget>(
        bytes, Budget::Words{"bytes", "remove what is not used any more, close other sessions",
                             "blob_store_bytes"});
  }

  /// Room for `size` bytes, which `budget` must have now. `hash` is what they must hash to; "":
  /// anything. Fails with INVALID_ARGUMENT, RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<Incoming> begin(std::string hash, u64 size,
                                         std::shared_ptr<Budget> budget) const;
  /// Bytes that were accepted once: they count, whatever the limits are now.
  [[nodiscard]] static BufferPtr restore(std::string bytes, std::shared_ptr<Budget> budget);
  /// The blob of this hash, or null.
  [[nodiscard]] BufferPtr find(std::string_view hash) const;
  /// The Buffer that stands for this content from now on: `buffer`, or one that was there before.
  [[nodiscard]] BufferPtr put(const std::string& hash, BufferPtr buffer);

  [[nodiscard]] const BlobLimits& limits() const { return limits_; }
  /// Of all blobs; a tenant's is a part of it.
  [[nodiscard]] const std::shared_ptr<Budget>& budget() const { return budget_; }

 private:
  void sweep();  // forgets hashes whose bytes are gone; under mutex_

  const BlobLimits limits_;
  const std::shared_ptr<Budget> budget_;
  mutable std::mutex mutex_;
  std::map<std::string, std::weak_ptr<const Buffer>, std::less<>> blobs_;
  std::size_t sweep_at_ = 64;
};

}  // namespace heliograph::server
