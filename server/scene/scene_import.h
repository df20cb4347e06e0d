// Assembles an imported scene file. Called by ImportScene.
#pragma once

#include <optional>
#include <string>

#include "server/convert/export.h"
#include "server/store/session_arrays.h"

namespace heliograph::server {

struct ImportedScene {
  SceneDescription description;
  std::string request_id;
  std::string name;
  v1::Lifetime lifetime = v1::LIFETIME_UNSPECIFIED;
};

/// Assembles the chunks of a scene file. Checks blobs against their hashes; the session keeps them.
/// Thread: one at a time; the arrays outlive it.
class SceneImport {
 public:
  /// header   charge of the owner's bytes, for a header in chunks
  explicit SceneImport(SessionArrays& arrays, Charge header = {})
      : arrays_(arrays), header_charge_(std::move(header)) {}
  /// Appends a chunk. INVALID_ARGUMENT (out of order, another format, a blob of another hash),
  /// RESOURCE_EXHAUSTED.
  [[nodiscard]] Status append(const v1::SceneChunk& chunk);
  /// Returns the scene once all chunks have arrived.
  [[nodiscard]] Expected<ImportedScene> finish();

 private:
  [[nodiscard]] Status begin(v1::SceneChunk::Header header);
  [[nodiscard]] Status parse_header();
  [[nodiscard]] Status append_blob(std::string_view bytes);
  /// Finishes the complete blob and begins the next one, empty blobs too.
  [[nodiscard]] Status advance();
  [[nodiscard]] v1::UploadBlobRequest upload_of(std::size_t blob) const;

  SessionArrays& arrays_;
  std::string header_bytes_;
  Charge header_charge_;
  std::optional<v1::SceneChunk::Header> header_;
  std::size_t blob_ = 0;
  u64 left_ = 0;                      // bytes missing from the current blob
  std::optional<Incoming> incoming_;  // nullopt: the current blob is known already
};

}  // namespace heliograph::server
