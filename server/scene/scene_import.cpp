// Chunks to a scene's description.
#include "server/scene/scene_import.h"

#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/scene_file.h"

namespace heliograph::server {

v1::UploadBlobRequest SceneImport::upload_of(std::size_t blob) const {
  v1::UploadBlobRequest upload;
  upload.set_sha256(header_->blobs(int(blob)));
  upload.set_size(header_->sizes(int(blob)));
  return upload;
}

Status SceneImport::begin(v1::SceneChunk::Header header) {
  if (header.format() != kSceneFormat)
    return fail(Code::kInvalidArgument, "header.format",
                fmt::format("is '{}'; this version reads '{}'", header.format(), kSceneFormat));
  HELIO_CHECK(check_known(header), "header");
  if (header.blobs_size() != header.sizes_size())
    return fail(Code::kInvalidArgument, "header.sizes",
                fmt::format("has {} entries for {} blobs; the file is damaged", header.sizes_size(),
                            header.blobs_size()));
  for (int i = 0; i < header.blobs_size(); ++i)
    HELIO_CHECK(check_hash(header.blobs(i)), indexed("header.blobs", u64(i)));
  header_ = std::move(header);
  blob_ = 0;
  return advance();
}

Status SceneImport::advance() {
  while (left_ == 0) {
    if (incoming_) {
      HELIO_CHECK(arrays_.finish(upload_of(blob_ - 1), std::move(*incoming_)),
                  indexed("header.blobs", blob_ - 1));
      incoming_.reset();
    }
    if (blob_ == std::size_t(header_->blobs_size())) return {};
    const v1::UploadBlobRequest upload = upload_of(blob_);
    HELIO_TAKE(incoming_, arrays_.begin(upload), indexed("header.blobs", blob_));
    left_ = upload.size();
    ++blob_;
  }
  return {};
}

Status SceneImport::append_blob(std::string_view bytes) {
  if (bytes.size() > left_)
    return fail(Code::kInvalidArgument, "chunk",
                "spans two blobs, or more than the header lists; the file is damaged");
  if (incoming_) HELIO_CHECK(incoming_->append(bytes), "chunk");
  left_ -= bytes.size();
  return advance();
}

Status SceneImport::parse_header() {
  v1::SceneChunk::Header header;
  if (!header.ParseFromString(header_bytes_))
    return fail(Code::kInvalidArgument, "header_chunk", "is no header; the file is damaged");
  header_bytes_.clear();
  return begin(std::move(header));
}

Status SceneImport::append(const v1::SceneChunk& chunk) {
  HELIO_TRY(check_known(chunk));
  switch (chunk.part_case()) {
    case v1::SceneChunk::kHeader:
      if (header_ || !header_bytes_.empty())
        return fail(Code::kInvalidArgument, "header", "comes twice; send one first");
      return begin(chunk.header());
    case v1::SceneChunk::kHeaderChunk:
      if (header_)
        return fail(Code::kInvalidArgument, "header_chunk",
                    "comes after the header; send it first");
      if (header_bytes_.size() + chunk.header_chunk().size() > kLargestHeader)
        return fail(Code::kResourceExhausted, "header_chunk",
                    fmt::format("grows past {} bytes; split the scene", kLargestHeader));
      HELIO_CHECK(header_charge_.resize(header_bytes_.size() + chunk.header_chunk().size()),
                  "header_chunk");
      header_bytes_ += chunk.header_chunk();
      return {};
    case v1::SceneChunk::kChunk:
      if (!header_ && header_bytes_.empty())
        return fail(Code::kInvalidArgument, "chunk", "comes before the header; send that first");
      if (!header_) HELIO_TRY(parse_header());
      return append_blob(chunk.chunk());
    case v1::SceneChunk::PART_NOT_SET:
      break;
  }
  return fail(Code::kInvalidArgument, "", "is empty; set header, header_chunk or chunk");
}

Expected<ImportedScene> SceneImport::finish() {
  if (!header_ && !header_bytes_.empty()) HELIO_TRY(parse_header());
  if (!header_)
    return fail(Code::kInvalidArgument, "header", "is missing; the file is empty or cut short");
  if (left_ > 0)
    return fail(Code::kInvalidArgument, "chunk",
                fmt::format("blob {} lacks {} bytes; the file is cut short", blob_ - 1, left_));
  ImportedScene scene{.description = {},
                      .request_id = header_->request_id(),
                      .name = header_->name(),
                      .lifetime = header_->lifetime()};
  auto description = to_description(std::move(*header_), arrays_);
  if (!description) return std::unexpected(std::move(description).error().at("header"));
  scene.description = std::move(*description);
  return scene;
}

}  // namespace heliograph::server
