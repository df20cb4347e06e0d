// One page of a list, as https://google.aip.dev/158 has them. Used by the calls that list.
#pragma once

#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Takes entries in the order of their keys, until it is full; a page holds an entry at least. Its
/// token is the key of the first entry that it has no room for.
class Page {
 public:
  static constexpr u64 kBytes = 1u << 20;

  /// size: the most entries; 0: as many as a page holds. INVALID_ARGUMENT, at "page_token", for
  /// what no page gave.
  [[nodiscard]] static Expected<Page> open(u32 size, const std::string& token);
  /// The first key that belongs to it.
  [[nodiscard]] u64 first() const { return first_; }
  /// Whether an entry is in it, at or after first(). False: the page is full, and so it stays.
  [[nodiscard]] bool take(u64 key, u64 bytes);
  /// Of the next page; "": there is none.
  [[nodiscard]] const std::string& next() const { return next_; }

 private:
  u32 size_ = 0;
  u64 first_ = 0;
  u32 count_ = 0;
  u64 bytes_ = 0;
  std::string next_;
};

}  // namespace heliograph::server
