// See sources.h.
#include "server/journal/sources.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "server/convert/scene_file.h"
#include "server/decode/asset.h"
#include "server/os/hash.h"

namespace heliograph::server {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

/// Returns the upload or buffer that an array consumes; "": none.
std::string consumed_by(const v1::Array& array) {
  const v1::BufferRef& buffer = array.buffer();
  if (array.has_buffer())
    return fmt::format("buffer {} {} {}", buffer.buffer(), buffer.generation(), buffer.offset());
  return array.has_upload() ? "upload " + array.upload() : "";
}

/// Replaces uploads and buffers that a message's arrays consume, nested ones too, by the hashes of
/// the bytes.
void name_by_hash(Message& message, const std::map<std::string, std::string>& consumed) {
  if (message.GetDescriptor() == v1::Array::descriptor()) {
    auto& array = static_cast<v1::Array&>(message);
    if (const std::string place = consumed_by(array); !place.empty())
      array.set_blob(consumed.at(place));
    return;
  }
  const auto& reflection = *message.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_map()) continue;
    if (!field->is_repeated()) {
      name_by_hash(*reflection.MutableMessage(&message, field), consumed);
      continue;
    }
    for (int i = 0; i < reflection.FieldSize(message, field); ++i)
      name_by_hash(*reflection.MutableRepeatedMessage(&message, field, i), consumed);
  }
}

constexpr std::size_t kLargestInRecord = 256 << 10;
constexpr std::size_t kModels = 16;  // models that recovery caches

std::span<const std::byte> bytes_of(const std::string& text) {
  return std::as_bytes(std::span(text));
}

}  // namespace

// ---------------------------------------------------------------- RecordingSource

Status RecordingSource::store(const std::string& hash, std::span<const std::byte> bytes) {
  auto file = files_.put(hash, bytes, Room::kEdit);
  if (!file) {
    status_ = std::unexpected(file.error());
    return status_;
  }
  held_.push_back(std::move(*file));
  return {};
}

Expected<BufferPtr> RecordingSource::bytes(const v1::Array& array) {
  auto buffer = inner_.bytes(array);
  if (!buffer || array.has_inline_()) return buffer;
  const std::string hash = array.has_blob() ? array.blob() : files_.hash_of(*buffer);
  if (const std::string place = consumed_by(array); !place.empty()) consumed_[place] = hash;
  HELIO_TRY(store(hash, (*buffer)->bytes()));
  return buffer;
}

Expected<std::string> RecordingSource::store(const Asset& asset) {
  decode::Result message;
  Status status;
  write_asset(asset, message, [&](const BufferPtr& bytes, v1::Array& array) {
    if (bytes->bytes().size() <= kLargestInline)
      return array.set_inline_(bytes->bytes().data(), bytes->bytes().size());
    array.set_blob(files_.hash_of(bytes));
    if (status) status = store(array.blob(), bytes->bytes());
  });
  HELIO_TRY(status);
  const std::string bytes = serialize(message), hash = sha256(bytes);
  HELIO_TRY(store(hash, bytes_of(bytes)));
  return hash;
}

Expected<std::shared_ptr<const Asset>> RecordingSource::asset(std::string_view hash) {
  auto asset = inner_.asset(hash);
  if (!asset || assets_.contains(std::string(hash))) return asset;
  auto file = store(**asset);
  if (!file) return std::unexpected(std::move(file).error());
  assets_.emplace(hash, std::move(*file));
  return asset;
}

std::string RecordingSource::fill(const v1::Transaction& transaction, journal::Record& record) {
  std::string text;
  if (consumed_.empty()) {
    transaction.SerializeToString(&text);
  } else {
    v1::Transaction named = transaction;
    name_by_hash(named, consumed_);
    named.SerializeToString(&text);
  }
  for (const auto& [asset, file] : assets_) {
    journal::AssetFile* added = record.add_assets();
    added->set_asset(asset);
    added->set_file(file);
  }
  if (text.size() <= kLargestInRecord) {
    record.set_transaction(std::move(text));
    return "";
  }
  record.set_transaction_file(sha256(text));
  (void)store(record.transaction_file(), bytes_of(text));  // status() reports a failure
  return text;
}

// ---------------------------------------------------------------- RecoveringSource

void RecoveringSource::expect(const journal::Record& record) {
  expected_.clear();
  for (const journal::AssetFile& each : record.assets()) expected_[each.asset()] = each.file();
}

Expected<std::string> RecoveringSource::content(const std::string& hash) {
  auto file = files_.read(hash);
  if (!file) return std::unexpected(std::move(file).error());
  held_.push_back(std::move(file->first));
  return std::move(file->second);
}

Expected<BufferPtr> RecoveringSource::load(const std::string& hash) {
  BufferPtr loaded = owner_.blobs.find(hash);
  BlobFilePtr file = files_.find(hash);
  if (loaded && file) {
    held_.push_back(std::move(file));
    return loaded;
  }
  auto bytes = content(hash);
  if (!bytes) return std::unexpected(std::move(bytes).error());
  return owner_.blobs.put(hash, BlobStore::restore(std::move(*bytes), owner_.ledger.bytes));
}

Expected<BufferPtr> RecoveringSource::bytes(const v1::Array& array) {
  if (array.has_blob()) return load(array.blob());
  if (array.has_inline_()) return BlobStore::restore(array.inline_(), owner_.ledger.bytes);
  return fail(Code::kInternal, "", "names bytes that no file holds");
}

Expected<std::shared_ptr<const Asset>> RecoveringSource::asset(std::string_view hash) {
  if (assets_.size() >= kModels && !assets_.contains(hash)) assets_.clear();
  Loaded& loaded = assets_[std::string(hash)];
  if (!loaded.asset) {
    const auto file = expected_.find(hash);
    if (file == expected_.end()) return fail(Code::kInternal, "", "the record names no such asset");
    std::vector<BlobFilePtr> before = take_files();
    auto bytes = content(file->second);
    if (!bytes) return std::unexpected(std::move(bytes).error());
    decode::Result message;
    if (!message.ParseFromString(*bytes)) return fail(Code::kInternal, "", "is no asset");
    auto asset = read_asset(message, std::string(hash), *this);
    if (!asset) return std::unexpected(std::move(asset).error());
    loaded = {.asset = std::move(*asset), .files = take_files()};
    held_ = std::move(before);
  }
  std::ranges::copy(loaded.files, std::back_inserter(held_));
  return loaded.asset;
}

}  // namespace heliograph::server
