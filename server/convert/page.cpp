// See page.h.
#include "server/convert/page.h"

#include <charconv>

namespace heliograph::server {

Expected<Page> Page::open(u32 size, const std::string& token) {
  Page page;
  page.size_ = size;
  if (token.empty()) return page;
  const char* end = token.data() + token.size();
  if (const auto [at, error] = std::from_chars(token.data(), end, page.first_);
      error != std::errc() || at != end)
    return fail(Code::kInvalidArgument, "page_token",
                "is none that a page of this list gave; leave it out to begin");
  return page;
}

bool Page::take(u64 key, u64 bytes) {
  if (!next_.empty()) return false;
  if (count_ > 0 && (count_ == size_ || bytes_ + bytes > kBytes)) {
    next_ = std::to_string(key);
    return false;
  }
  ++count_;
  bytes_ += bytes;
  return true;
}

}  // namespace heliograph::server
