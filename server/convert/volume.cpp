// Volumes: kept as the bytes of their file.
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {

Expected<PutVolume> to_volume(const v1::Volume& message, ArraySource& source) {
  if (message.clear_size() > 0)
    return fail(Code::kInvalidArgument, "clear[0]",
                "a volume has no field that can be cleared; send the volume again");
  HELIO_CHECK(check_hash(message.blob()), "blob");
  Volume volume;
  HELIO_TAKE(volume.bytes, source.blob(message.blob()), "blob");
  volume.grids = {message.grids().begin(), message.grids().end()};
  return PutVolume{std::make_shared<const Volume>(std::move(volume))};
}

v1::Volume to_proto(const PutVolume& patch, const ArraySink& sink) {
  v1::Volume message;
  if (!patch.volume) return message;
  v1::Array bytes;
  sink(patch.volume->bytes, bytes);
  message.set_blob(bytes.blob());
  message.mutable_grids()->Add(patch.volume->grids.begin(), patch.volume->grids.end());
  return message;
}

}  // namespace heliograph::server
