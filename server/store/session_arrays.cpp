// A session's blobs, uploads and assets.
#include "server/store/session_arrays.h"

#include <fmt/format.h>

#include <cstring>

#include "server/convert/fields.h"
#include "server/convert/limits.h"

namespace heliograph::server {
namespace {

/// Returns a key for the bytes that a reference names.
std::string name_of(const v1::BufferRef& ref) {
  return fmt::format("{} {} {}", ref.buffer(), ref.offset(), ref.size());
}

/// Copied bytes of a message with their charge.
struct Copied {
  std::vector<std::byte> bytes;
  Charge charge;
};

}  // namespace

Expected<BufferPtr> SessionArrays::copy(std::string_view bytes) const {
  auto charge = Charge::take(budget_, bytes.size());
  if (!charge) return std::unexpected(std::move(charge).error());
  auto owner = std::make_shared<Copied>();
  owner->charge = std::move(*charge);
  owner->bytes.resize(bytes.size());
  if (!bytes.empty()) std::memcpy(owner->bytes.data(), bytes.data(), bytes.size());
  return std::make_shared<const Buffer>(owner, std::span<const std::byte>(owner->bytes));
}

void SessionArrays::bring(Recent::Kind kind, const std::string& name, BufferPtr bytes) {
  const u64 size = bytes->bytes().size();
  const std::lock_guard lock(mutex_);
  recent_.bring(kind, name, std::move(bytes), size);
}

Expected<Incoming> SessionArrays::make_room(const v1::UploadBlobRequest& first) const {
  HELIO_TRY(budget_->admit(Work::kUploads, first.size()));
  return blobs_.begin(first.sha256(), first.size(), budget_);
}

Expected<std::optional<Incoming>> SessionArrays::begin(const v1::UploadBlobRequest& first) {
  const std::string& hash = first.sha256();
  if (hash.empty() && first.request_id().empty())
    return fail(Code::kInvalidArgument, "request_id",
                "is empty; name the upload by its sha256 or by a request_id");
  HELIO_TRY(check_request_id(first.request_id()));
  sweep();
  if (BufferPtr present = hash.empty() ? nullptr : blobs_.find(hash)) {
    bring(Recent::Kind::kBlob, hash, std::move(present));
    return std::nullopt;
  }
  if (hash.empty()) {
    const std::lock_guard lock(mutex_);
    if (recent_.find(Recent::Kind::kUpload, first.request_id())) return std::nullopt;
  }
  auto incoming = make_room(first);
  if (!incoming && incoming.error().code == Code::kResourceExhausted && forget_named())
    incoming = make_room(first);
  if (!incoming) return std::unexpected(std::move(incoming).error());
  incoming->hold(bringing_);
  return std::optional(std::move(*incoming));
}

Status SessionArrays::finish(const v1::UploadBlobRequest& first, Incoming incoming) {
  auto buffer = incoming.finish();
  if (!buffer) return std::unexpected(std::move(buffer).error());
  const std::string& hash = first.sha256();
  if (hash.empty())
    bring(Recent::Kind::kUpload, first.request_id(), std::move(*buffer));
  else
    bring(Recent::Kind::kBlob, hash, blobs_.put(hash, std::move(*buffer)));
  return {};
}

void SessionArrays::sweep() {
  Recent::Things gone;  // freed after the lock is released
  const std::lock_guard lock(mutex_);
  gone = recent_.sweep(bringing_.use_count() > 1);
}

bool SessionArrays::forget_named() {
  Recent::Things gone;
  const std::lock_guard lock(mutex_);
  gone = recent_.forget_named();
  return !gone.empty();
}

std::string SessionArrays::hold(BufferPtr bytes) {
  std::string hash = sha256(bytes->bytes());
  bring(Recent::Kind::kBlob, hash, blobs_.put(hash, std::move(bytes)));
  return hash;
}

std::shared_ptr<const StoredAsset> SessionArrays::hold(std::shared_ptr<const StoredAsset> asset) {
  asset = assets_.put(std::move(asset));
  keep(asset);
  return asset;
}

/// Keeps an asset. The texels of a picture are kept as a blob, since edits name them by that: the
/// asset itself is not pinned as unused.
void SessionArrays::keep(const std::shared_ptr<const StoredAsset>& asset) {
  const std::string& hash = asset->info.sha256();
  const std::lock_guard lock(mutex_);
  if (!asset->texels) return recent_.bring(Recent::Kind::kAsset, hash, asset, asset->bytes);
  recent_.bring(Recent::Kind::kBlob, asset->info.texels().blob(), asset->texels, asset->bytes);
  recent_.use(Recent::Kind::kAsset, hash, asset, asset->bytes);
}

std::shared_ptr<const StoredAsset> SessionArrays::find_asset(std::string_view hash) {
  auto found = assets_.find(hash);
  if (found) keep(found);
  return found;
}

Expected<BufferPtr> SessionArrays::bytes(const v1::Array& array) {
  switch (array.source_case()) {
    case v1::Array::kInline:
      if (array.inline_().size() > blobs_.limits().inline_bytes)
        return fail(Code::kInvalidArgument, "inline",
                    fmt::format("has {} bytes; upload arrays of more than {}",
                                array.inline_().size(), blobs_.limits().inline_bytes));
      return copy(array.inline_());
    case v1::Array::kBlob:
      return find_blob(array.blob());
    case v1::Array::kUpload:
      return take_upload(array.upload());
    case v1::Array::kBuffer:
      if (auto found = take_returned(array.buffer())) return found;
      return shared_.use(array.buffer());
    case v1::Array::SOURCE_NOT_SET:
      break;
  }
  return fail(Code::kInvalidArgument, "", "has no bytes; set inline, blob, upload or buffer");
}

Expected<bool> SessionArrays::read(const v1::Array& array, u64 bytes, const TakePiece& take) {
  if (!array.has_buffer() || array.buffer().size() != bytes) return false;
  return shared_.read_lent(array.buffer(), take);
}

Expected<BufferPtr> SessionArrays::take(const v1::Array& array, u64 bytes, Numbers kind) {
  if (!array.has_buffer() || array.buffer().size() != bytes) return nullptr;
  return shared_.take_lent(array.buffer(), kind);
}

BufferPtr SessionArrays::take_returned(const v1::BufferRef& ref) {
  if (ref.generation() != 0) return nullptr;  // lent
  const std::lock_guard lock(mutex_);
  return std::static_pointer_cast<const Buffer>(recent_.take(Recent::Kind::kBuffer, name_of(ref)));
}

Expected<BufferPtr> SessionArrays::take_upload(const std::string& request_id) {
  Recent::Thing found;
  {
    const std::lock_guard lock(mutex_);
    found = recent_.take(Recent::Kind::kUpload, request_id);
  }
  if (found) return std::static_pointer_cast<const Buffer>(std::move(found));
  return fail(
      Code::kNotFound, "upload",
      fmt::format("this session has no upload '{}'; upload it again: a use consumes it, and "
                  "so does the time of the limit recent_seconds",
                  request_id));
}

void SessionArrays::give_back(const std::vector<UsedUpload>& uploads) {
  for (const UsedUpload& used : uploads) {
    if (used.array.buffer().generation() != 0) continue;  // lent: a use does not consume it
    if (used.array.has_buffer())
      bring(Recent::Kind::kBuffer, name_of(used.array.buffer()), used.bytes);
    else
      bring(Recent::Kind::kUpload, used.array.upload(), used.bytes);
  }
}

Expected<BufferPtr> SessionArrays::blob(std::string_view hash) {
  if (BufferPtr found = blobs_.find(hash)) return found;
  return fail(Code::kNotFound, "",
              fmt::format("the daemon has no bytes of sha256 {} (any more); upload it again with "
                          "UploadBlob",
                          hex(hash)));
}

void SessionArrays::used(const std::string& hash, const BufferPtr& bytes) {
  const std::lock_guard lock(mutex_);
  recent_.use(Recent::Kind::kBlob, hash, bytes, bytes->bytes().size());
}

Expected<BufferPtr> SessionArrays::find_blob(const std::string& hash) {
  BufferPtr buffer;
  HELIO_CHECK(check_hash(hash), "blob");
  HELIO_TAKE(buffer, blob(hash), "blob");
  used(hash, buffer);
  return buffer;
}

Expected<std::shared_ptr<const Asset>> SessionArrays::asset(std::string_view hash) {
  if (const auto found = assets_.find(hash); found && found->asset) {
    const std::lock_guard lock(mutex_);
    recent_.use(Recent::Kind::kAsset, found->info.sha256(), found, found->bytes);
    return found->asset;
  }
  return fail(Code::kNotFound, "",
              fmt::format("the daemon has no asset of sha256 {} (any more); upload it again, and "
                          "decode its bundle with DecodeAsset",
                          hex(hash)));
}

}  // namespace heliograph::server
