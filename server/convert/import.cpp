// Chunks to a transaction.
#include <fmt/format.h>

#include "server/convert/export.h"
#include "server/convert/fields.h"
#include "server/convert/scene_file.h"

namespace heliograph::server {
namespace {

Expected<SceneDescription::KeptLibrary> to_library(const v1::SceneChunk::Library& message) {
  HELIO_CHECK(check_hash(message.asset()), "asset");
  SceneDescription::KeptLibrary kept{.asset = message.asset(), .edits = {}};
  for (const v1::Ref& object : message.objects()) {
    if (object.target_case() != v1::Ref::kCreatedByEdit &&
        object.target_case() != v1::Ref::TARGET_NOT_SET)
      return fail(Code::kInvalidArgument, indexed("objects", kept.edits.size()),
                  "is no created_by_edit; the file is damaged");
    kept.edits.push_back(object.has_created_by_edit() ? std::optional(object.created_by_edit())
                                                      : std::nullopt);
  }
  return kept;
}

}  // namespace

Expected<SceneDescription> to_description(v1::SceneChunk::Header&& header, ArraySource& source) {
  SceneDescription description;
  HELIO_TAKE(description.scene, to_transaction(std::move(*header.mutable_transaction()), source),
             "transaction");
  HELIO_TAKE(description.previous, to_transaction(std::move(*header.mutable_previous()), source),
             "previous");
  for (int i = 0; i < header.libraries_size(); ++i)
    HELIO_TAKE(description.libraries.emplace_back(), to_library(header.libraries(i)),
               indexed("libraries", u64(i)));
  return description;
}

}  // namespace heliograph::server
