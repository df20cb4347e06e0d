// Budgets, uploads and the table of blobs.
#include "server/store/blobs.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <new>
#include <span>
#include <utility>

namespace heliograph::server {
namespace {

/// Charged bytes.
struct Restored {
  std::string bytes;
  Charge charge;
};

}  // namespace

struct Incoming::Storage {
  std::unique_ptr<std::byte[]> bytes;
  u64 size = 0;
  Charge charge;
  u64 charged = 0;  // charged bytes of the size

  [[nodiscard]] Status set_charged(u64 amount) {
    HELIO_TRY(charge.resize(amount + BlobStore::kOverhead));
    charged = amount;
    return {};
  }
};

u64 Incoming::size() const { return storage_->size; }

Status Incoming::append(std::string_view chunk) {
  if (chunk.size() > storage_->size - filled_)
    return fail(
        Code::kInvalidArgument, "size",
        fmt::format("announced {} bytes, and more came; announce them all", storage_->size));
  HELIO_TRY(charge(filled_ + chunk.size()));
  HELIO_TRY(storage_->charge.check_memory(Work::kUploads));
  std::memcpy(storage_->bytes.get() + filled_, chunk.data(), chunk.size());
  if (!hash_.empty()) digest_.add(chunk);
  filled_ += chunk.size();
  return {};
}

/// Charges these bytes, and a window ahead of them unless that is refused now.
Status Incoming::charge(u64 bytes) {
  if (bytes <= storage_->charged) return {};
  if (storage_->set_charged(std::min(bytes + window_, storage_->size))) return {};
  if (auto least = storage_->set_charged(bytes); !least)
    return std::unexpected(std::move(least).error().at("size"));
  return {};
}

Expected<BufferPtr> Incoming::finish() {
  if (filled_ != storage_->size)
    return fail(Code::kInvalidArgument, "size",
                fmt::format("announced {} bytes, {} came; send them all", storage_->size, filled_));
  if (!hash_.empty() && digest_.finish() != hash_)
    return fail(Code::kInvalidArgument, "sha256",
                "is not the hash of these bytes; hash what you send");
  return std::make_shared<const Buffer>(
      storage_, std::span<const std::byte>(storage_->bytes.get(), storage_->size));
}

Expected<Incoming> BlobStore::begin(std::string hash, u64 size,
                                    std::shared_ptr<Budget> budget) const {
  if (!hash.empty() && hash.size() != 32)
    return fail(Code::kInvalidArgument, "sha256",
                fmt::format("has {} bytes; a SHA-256 has 32", hash.size()));
  if (size > limits_.blob_bytes) {
    auto error = fail(Code::kResourceExhausted, "size",
                      fmt::format("is {} bytes; one blob may have {}: split it, or raise the "
                                  "daemon's limit",
                                  size, limits_.blob_bytes));
    error.error().limit = "blob_bytes";
    error.error().needed = size;
    error.error().available = limits_.blob_bytes;
    return error;
  }
  auto charge = Charge::take(std::move(budget), size + kOverhead);  // refuses what never fits
  if (!charge) return std::unexpected(std::move(charge).error().at("size"));
  auto storage = std::make_shared<Incoming::Storage>();
  storage->bytes.reset(new (std::nothrow) std::byte[std::max<u64>(size, 1)]);
  if (!storage->bytes)
    return fail(Code::kResourceExhausted, "size", "the machine has no memory for it; try later");
  storage->size = size;
  storage->charge = std::move(*charge);
  HELIO_TRY(storage->set_charged(std::min(limits_.window_bytes, size)));
  return Incoming(std::move(storage), std::move(hash), limits_.window_bytes);
}

BufferPtr BlobStore::restore(std::string bytes, std::shared_ptr<Budget> budget) {
  const u64 size = bytes.size() + kOverhead;
  const auto owner = std::make_shared<const Restored>(
      Restored{.bytes = std::move(bytes), .charge = Charge::count(std::move(budget), size)});
  return std::make_shared<const Buffer>(owner, std::as_bytes(std::span(owner->bytes)));
}

BufferPtr BlobStore::find(std::string_view hash) const {
  const std::lock_guard lock(mutex_);
  const auto found = blobs_.find(hash);
  return found == blobs_.end() ? nullptr : found->second.lock();
}

BufferPtr BlobStore::put(const std::string& hash, BufferPtr buffer) {
  const std::lock_guard lock(mutex_);
  auto& entry = blobs_[hash];
  if (auto present = entry.lock()) return present;
  entry = buffer;
  sweep();
  return buffer;
}

void BlobStore::sweep() {
  if (blobs_.size() < sweep_at_) return;
  std::erase_if(blobs_, [](const auto& entry) { return entry.second.expired(); });
  sweep_at_ = std::max<std::size_t>(64, 2 * blobs_.size());
}

}  // namespace heliograph::server
