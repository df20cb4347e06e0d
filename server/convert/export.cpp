// Snapshot to chunks.
#include "server/convert/export.h"

#include "renderer/scene/scene.h"
#include "server/convert/scene_file.h"
#include "server/os/hash.h"

namespace heliograph::server {

v1::SceneChunk::Header scene_header(const Snapshot& snapshot, const ArraySink& sink) {
  v1::SceneChunk::Header header;
  header.set_format(kSceneFormat);
  v1::Transaction& scene = *header.mutable_transaction();
  const SceneDescription description =
      describe(snapshot, [&](const Edit& edit) { *scene.add_edits() = to_proto(edit, sink); });
  if (!description.previous.edits.empty())
    *header.mutable_previous() = to_proto(description.previous, sink);
  for (const auto& kept : description.libraries) {
    v1::SceneChunk::Library* library = header.add_libraries();
    library->set_asset(kept.asset);
    for (const auto& edit : kept.edits) {
      v1::Ref* object = library->add_objects();
      if (edit) object->set_created_by_edit(*edit);
    }
  }
  return header;
}

SceneExport::SceneExport(const Snapshot& snapshot) {
  header_ = scene_header(snapshot, [this](const BufferPtr& bytes, v1::Array& array) {
    if (bytes->bytes().size() <= kLargestInline)
      array.set_inline_(bytes->bytes().data(), bytes->bytes().size());
    else
      add_blob(bytes, array);
  });
  for (const BufferPtr& blob : blobs_) {
    header_.add_blobs(hashes_.at(blob->serial()));
    header_.add_sizes(blob->bytes().size());
  }
  if (header_.ByteSizeLong() > kSceneChunk) header_bytes_ = serialize(header_);
}

void SceneExport::add_blob(const BufferPtr& bytes, v1::Array& array) {
  auto& hash = hashes_[bytes->serial()];
  if (hash.empty()) {
    hash = sha256(bytes->bytes());
    if (index_.emplace(hash, u32(blobs_.size())).second) blobs_.push_back(bytes);
  }
  array.set_blob(hash);
}

bool SceneExport::next(v1::SceneChunk& chunk) {
  chunk.Clear();
  if (!header_sent_ && header_bytes_.empty()) {
    header_sent_ = true;
    *chunk.mutable_header() = std::move(header_);
    return true;
  }
  if (!header_sent_) {
    chunk.set_header_chunk(header_bytes_.substr(offset_, kSceneChunk));
    offset_ += chunk.header_chunk().size();
    header_sent_ = offset_ == header_bytes_.size();
    if (header_sent_) offset_ = 0;
    return true;
  }
  if (blob_ == blobs_.size()) return false;
  const auto bytes = blobs_[blob_]->bytes();
  const u64 size = std::min<u64>(kSceneChunk, bytes.size() - offset_);
  chunk.set_chunk(bytes.data() + offset_, size);
  offset_ += size;
  if (offset_ == bytes.size()) {
    ++blob_;
    offset_ = 0;
  }
  return true;
}

}  // namespace heliograph::server
