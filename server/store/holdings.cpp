// A session's blobs, uploads and assets.
#include "server/store/holdings.h"

#include <fmt/format.h>

#include <cstring>

#include "server/convert/fields.h"
#include "server/convert/limits.h"

namespace heliograph::server {
namespace {

/// The blob that an array names.
Expected<BufferPtr> find_blob(Holdings& holdings, const std::string& hash) {
  BufferPtr buffer;
  HELIO_CHECK(check_hash(hash), "blob");
  HELIO_TAKE(buffer, holdings.blob(hash), "blob");
  return buffer;
}

/// Bytes of a message, and their share of the owner's budget.
struct Copied {
  std::vector<std::byte> bytes;
  Charge charge;
};

}  // namespace

Expected<BufferPtr> Holdings::copy(std::string_view bytes) const {
  auto charge = Charge::take(budget_, bytes.size());
  if (!charge) return std::unexpected(std::move(charge).error());
  auto owner = std::make_shared<Copied>();
  owner->charge = std::move(*charge);
  owner->bytes.resize(bytes.size());
  if (!bytes.empty()) std::memcpy(owner->bytes.data(), bytes.data(), bytes.size());
  return std::make_shared<const Buffer>(owner, std::span<const std::byte>(owner->bytes));
}

Expected<std::optional<Incoming>> Holdings::begin(const v1::UploadBlobRequest& first) {
  const std::string& hash = first.sha256();
  if (hash.empty() && first.request_id().empty())
    return fail(Code::kInvalidArgument, "request_id",
                "is empty; name the upload by its sha256 or by a request_id");
  HELIO_TRY(check_request_id(first.request_id()));
  if (!hash.empty()) {
    if (BufferPtr present = blobs_.find(hash)) {
      const std::lock_guard lock(mutex_);
      held_[hash] = std::move(present);
      return std::nullopt;
    }
  } else {
    const std::lock_guard lock(mutex_);
    if (uploads_.contains(first.request_id())) return std::nullopt;
  }
  auto incoming = blobs_.begin(hash, first.size(), budget_);
  if (!incoming) return std::unexpected(std::move(incoming).error());
  return std::optional(std::move(*incoming));
}

Status Holdings::finish(const v1::UploadBlobRequest& first, Incoming incoming) {
  auto buffer = incoming.finish();
  if (!buffer) return std::unexpected(std::move(buffer).error());
  const std::string& hash = first.sha256();
  if (!hash.empty()) *buffer = blobs_.put(hash, std::move(*buffer));
  const std::lock_guard lock(mutex_);
  if (hash.empty())
    uploads_.emplace(first.request_id(), std::move(*buffer));
  else
    held_[hash] = std::move(*buffer);
  return {};
}

Expected<std::string> Holdings::hold(BufferPtr bytes) {
  auto charge = Charge::take(budget_, bytes->bytes().size());
  if (!charge) return std::unexpected(std::move(charge).error());
  std::string hash = sha256(bytes->bytes());
  BufferPtr present = blobs_.put(hash, std::move(bytes));
  const std::lock_guard lock(mutex_);
  if (held_.insert_or_assign(hash, std::move(present)).second) charges_[hash] = std::move(*charge);
  return hash;
}

std::shared_ptr<const StoredAsset> Holdings::hold(std::shared_ptr<const StoredAsset> asset) {
  asset = assets_.put(std::move(asset));
  const std::lock_guard lock(mutex_);
  models_[asset->info.sha256()] = asset;
  return asset;
}

std::shared_ptr<const StoredAsset> Holdings::find_asset(std::string_view hash) {
  auto asset = assets_.find(hash);
  return asset ? hold(std::move(asset)) : nullptr;
}

Expected<BufferPtr> Holdings::bytes(const v1::Array& array) {
  switch (array.source_case()) {
    case v1::Array::kInline:
      if (array.inline_().size() > blobs_.limits().inline_bytes)
        return fail(Code::kInvalidArgument, "inline",
                    fmt::format("has {} bytes; upload arrays of more than {}",
                                array.inline_().size(), blobs_.limits().inline_bytes));
      return copy(array.inline_());
    case v1::Array::kBlob:
      return find_blob(*this, array.blob());
    case v1::Array::kUpload:
      return take_upload(array.upload());
    case v1::Array::kBuffer:
      return shared_.use(array.buffer());
    case v1::Array::SOURCE_NOT_SET:
      break;
  }
  return fail(Code::kInvalidArgument, "", "has no bytes; set inline, blob, upload or buffer");
}

Expected<bool> Holdings::read(const v1::Array& array, u64 bytes, const TakePiece& take) {
  if (!array.has_buffer() || array.buffer().size() != bytes) return false;
  return shared_.read_lent(array.buffer(), take);
}

Expected<BufferPtr> Holdings::take(const v1::Array& array, u64 bytes, Numbers kind) {
  if (!array.has_buffer() || array.buffer().size() != bytes) return nullptr;
  return shared_.take_lent(array.buffer(), kind);
}

Expected<BufferPtr> Holdings::take_upload(const std::string& request_id) {
  const std::lock_guard lock(mutex_);
  auto node = uploads_.extract(request_id);
  if (node) return std::move(node.mapped());
  return fail(Code::kNotFound, "upload",
              fmt::format("this session has no upload '{}'; upload it again: a use consumes it",
                          request_id));
}

void Holdings::give_back(const std::vector<UsedUpload>& uploads) {
  for (const UsedUpload& used : uploads) {
    if (used.array.buffer().generation() != 0) continue;  // lent: it is still there
    if (used.array.has_buffer()) {
      shared_.give_back(used.array.buffer(), used.bytes);
      continue;
    }
    const std::lock_guard lock(mutex_);
    uploads_.emplace(used.array.upload(), used.bytes);
  }
}

Expected<BufferPtr> Holdings::blob(std::string_view hash) {
  if (BufferPtr found = blobs_.find(hash)) return found;
  return fail(Code::kNotFound, "",
              fmt::format("there is no blob {}; upload it with UploadBlob", hex(hash)));
}

Expected<std::shared_ptr<const Asset>> Holdings::asset(std::string_view hash) {
  const auto found = assets_.find(hash);
  if (found && found->asset) return found->asset;
  return fail(Code::kNotFound, "",
              fmt::format("there is no asset {}; decode its bundle with DecodeAsset", hex(hash)));
}

}  // namespace heliograph::server
