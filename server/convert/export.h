// Scene files: a snapshot as SceneChunks, and back. Called by ExportScene and ImportScene.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/scene.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

/// Returns the header of a scene file, without blobs: the edits that make the scene. The inverse
/// takes the edits out of the header.
[[nodiscard]] v1::SceneChunk::Header scene_header(const Snapshot& snapshot, const ArraySink& sink);
[[nodiscard]] Expected<SceneDescription> to_description(v1::SceneChunk::Header&& header,
                                                        ArraySource& source);

/// Splits a snapshot into a self-contained sequence of chunks, made one at a time: the header with
/// the edits that make it, then each array of more than 4 KiB once, by its hash. Thread: one at a
/// time.
class SceneExport {
 public:
  explicit SceneExport(const Snapshot& snapshot);
  /// Fills the next chunk; false when there is none.
  [[nodiscard]] bool next(v1::SceneChunk& chunk);

 private:
  void add_blob(const BufferPtr& bytes, v1::Array& array);

  v1::SceneChunk::Header header_;
  std::string header_bytes_;  // a header that exceeds one message
  std::vector<BufferPtr> blobs_;
  std::map<u64, std::string> hashes_;  // by serial
  std::map<std::string, u32> index_;   // by hash
  bool header_sent_ = false;
  std::size_t blob_ = 0;
  u64 offset_ = 0;  // bytes sent of the header or the current blob
};

}  // namespace heliograph::server
