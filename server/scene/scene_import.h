// A scene file on its way in. Called by ImportScene.
#pragma once

#include <optional>
#include <string>

#include "server/convert/export.h"
#include "server/store/holdings.h"

namespace heliograph::server {

struct ImportedScene {
  SceneDescription description;
  std::string request_id;
  std::string name;
  v1::Lifetime lifetime = v1::LIFETIME_UNSPECIFIED;
};

/// The chunks of a scene file on their way in. Blobs are checked against their hashes and held by
/// the session. Thread: one at a time; the holdings outlive it.
class SceneImport {
 public:
  /// header   charge of the owner's bytes, for a header in chunks
  explicit SceneImport(Holdings& holdings, Charge header = {})
      : holdings_(holdings), header_charge_(std::move(header)) {}
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
  Charge header_charge_;
  std::optional<v1::SceneChunk::Header> header_;
  std::size_t blob_ = 0;
  u64 left_ = 0;                      // bytes of the present blob to come
  std::optional<Incoming> incoming_;  // nullopt: the present blob is here already
};

}  // namespace heliograph::server
