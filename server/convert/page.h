// One page of a list, as https://google.aip.dev/158 has them. Used by the calls that list.
#pragma once

#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Collects entries in key order until it is full; it holds at least one. Its token is the key of
/// the first entry without room.
class Page {
 public:
  static constexpr u64 kBytes = 1u << 20;

  /// Opens a page. size: maximal number of entries; 0: as many as a page holds. INVALID_ARGUMENT,
  /// at "page_token", for a token that no page returned.
  [[nodiscard]] static Expected<Page> open(u32 size, const std::string& token);
  /// Returns the first key that belongs to it.
  [[nodiscard]] u64 first() const { return first_; }
  /// Adds an entry at or after first(). False: the page is full, and stays so.
  [[nodiscard]] bool take(u64 key, u64 bytes);
  /// Returns the token of the next page; "": none.
  [[nodiscard]] const std::string& next() const { return next_; }

 private:
  u32 size_ = 0;
  u64 first_ = 0;
  u32 count_ = 0;
  u64 bytes_ = 0;
  std::string next_;
};

}  // namespace heliograph::server
