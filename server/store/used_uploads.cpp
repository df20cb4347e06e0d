#include "server/store/used_uploads.h"

namespace heliograph::server {

Expected<BufferPtr> UsedUploads::bytes(const v1::Array& array) {
  auto found = arrays_.bytes(array);
  if (found && (array.has_buffer() || array.has_upload()))
    used_.push_back({.array = array, .bytes = *found});
  return found;
}

Expected<bool> UsedUploads::read(const v1::Array& array, u64 bytes, const TakePiece& take) {
  return arrays_.read(array, bytes, take);
}

Expected<BufferPtr> UsedUploads::take(const v1::Array& array, u64 bytes, Numbers kind) {
  return arrays_.take(array, bytes, kind);
}

Expected<std::shared_ptr<const Asset>> UsedUploads::asset(std::string_view hash) {
  return arrays_.asset(hash);
}

}  // namespace heliograph::server
