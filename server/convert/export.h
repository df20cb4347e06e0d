// Scene files: a snapshot as SceneChunks, and back. Called by ExportScene and ImportScene.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/scene.h"
#include "server/holdings.h"

namespace heliograph::server {

/// The header of a scene file without its blobs: the edits that make the scene. And back.
[[nodiscard]] v1::SceneChunk::Header scene_header(const Snapshot& snapshot, const ArraySink& sink);
[[nodiscard]] Expected<SceneDescription> to_description(const v1::SceneChunk::Header& header,
                                                        ArraySource& source);

/// A snapshot as a self-contained sequence of chunks, made one at a time: the header with the edits
/// that build it, then each array of more than 4 KiB once, by its hash. Thread: one at a time.
class SceneExport {
 public:
  explicit SceneExport(const Snapshot& snapshot);
  /// Fills the next chunk; false when there is none.
  [[nodiscard]] bool next(v1::SceneChunk& chunk);

 private:
  void add_blob(const BufferPtr& bytes, v1::Array& array);

  v1::SceneChunk::Header header_;
  std::string header_bytes_;  // of a header that does not fit one message
  std::vector<BufferPtr> blobs_;
  std::map<u64, std::string> hashes_;  // by serial
  std::map<std::string, u32> index_;   // by hash
  bool header_sent_ = false;
  std::size_t blob_ = 0;
  u64 offset_ = 0;  // bytes sent of the header or of the present blob
};

struct ImportedScene {
  SceneDescription description;
  std::string request_id;
  std::string name;
  std::string durability;
  bool shared = false;
};

/// The chunks of a scene file on their way in. Blobs are checked against their hashes and held by
/// the session. Thread: one at a time; the holdings outlive it.
class SceneImport {
 public:
  explicit SceneImport(Holdings& holdings) : holdings_(holdings) {}
  /// INVALID_ARGUMENT (out of order, not this format, not what a hash names), RESOURCE_EXHAUSTED.
  [[nodiscard]] Status append(const v1::SceneChunk& chunk);
  /// The scene, when all has come.
  [[nodiscard]] Expected<ImportedScene> finish();

 private:
  [[nodiscard]] Status begin(v1::SceneChunk::Header header);
  [[nodiscard]] Status parse_header();
  [[nodiscard]] Status append_blob(std::string_view bytes);
  /// Ends the blob that is complete and begins the next one; blobs of no bytes too.
  [[nodiscard]] Status advance();
  [[nodiscard]] v1::UploadBlobRequest upload_of(std::size_t blob) const;

  Holdings& holdings_;
  std::string header_bytes_;
  std::optional<v1::SceneChunk::Header> header_;
  std::size_t blob_ = 0;
  u64 left_ = 0;                      // bytes of the present blob to come
  std::optional<Incoming> incoming_;  // nullopt: the present blob is here already
};

}  // namespace heliograph::server
