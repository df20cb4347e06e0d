// See limits.h.
#include "server/convert/limits.h"

#include <fmt/format.h>

namespace heliograph::server {

Status check_count(const v1::Transaction& message, u64 most) {
  const u64 count = u64(message.edits_size());
  if (count <= most) return {};
  Error error{
      .code = Code::kResourceExhausted,
      .message = fmt::format(
          "has {} edits, {} are allowed: send several transactions (limit edits)", count, most),
      .where = "edits"};
  error.limit = "edits";
  error.needed = count;
  error.available = most;
  return std::unexpected(std::move(error));
}

Status check_request_id(std::string_view id) {
  constexpr std::size_t kMost = 256;
  if (id.size() <= kMost) return {};
  return fail(Code::kInvalidArgument, "request_id",
              fmt::format("has {} bytes; give at most {}", id.size(), kMost));
}

}  // namespace heliograph::server
