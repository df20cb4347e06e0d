// Flow control of streams: credits and waiting requests. Used by RenderBatch and Stream.
#pragma once

#include <fmt/format.h>

#include "renderer/base/error.h"
#include "server/config/config.h"

namespace heliograph::server {

/// Credits of a call whose first message names none.
inline constexpr u32 kDefaultCredits = 2;

/// Bytes of each call's requests, replies and frames that are not charged to its tenant: one that
/// has used up its quota can still look and ask.
inline constexpr u64 kFreeBytes = 64 << 10;
[[nodiscard]] inline u64 charged(u64 bytes) { return bytes > kFreeBytes ? bytes : 0; }

/// credits   of the call in total, those in use included
[[nodiscard]] inline Status check_credits(u64 credits, const Limits& limits) {
  if (credits <= limits.credits) return {};
  return std::unexpected(Error{
      .code = Code::kInvalidArgument,
      .message = fmt::format("a call may have {} credits in all (limit credits)", limits.credits),
      .where = "credits",
      .limit = "credits",
      .needed = credits,
      .available = limits.credits});
}

/// Words of a refusal of waiting requests.
struct Waiting {
  std::string where;
  std::string what;    // "more items"
  std::string remedy;  // when to send the next
};
/// bytes   of all that waits in the call
[[nodiscard]] inline Status check_waiting(u64 bytes, const Limits& limits, const Waiting& words) {
  if (bytes <= limits.waiting_bytes) return {};
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("{} wait than the daemon keeps; {} (limit waiting_bytes)",
                                     words.what, words.remedy),
              .where = words.where};
  error.limit = "waiting_bytes";
  error.needed = bytes;
  error.available = limits.waiting_bytes;
  return std::unexpected(std::move(error));
}

}  // namespace heliograph::server
