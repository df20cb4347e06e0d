// Uploads that one request consumed. Used by the calls that read edits.
#pragma once

#include <string>
#include <vector>

#include "server/store/session_arrays.h"

namespace heliograph::server {

/// Returns true for a refusal after which the same request may be sent again, once what it lacked
/// was brought or some time has passed.
[[nodiscard]] inline bool may_be_sent_again(const Error& why) {
  return why.code == Code::kNotFound || why.retry_seconds > 0;
}

/// An ArraySource over a session's arrays that records consumed uploads and buffers, and restores
/// them when the request may be sent again. Thread: one at a time.
class UsedUploads final : public ArraySource {
 public:
  explicit UsedUploads(SessionArrays& arrays) : arrays_(arrays) {}

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<bool> read(const v1::Array& array, u64 bytes,
                                    const TakePiece& take) override;
  [[nodiscard]] Expected<BufferPtr> take(const v1::Array& array, u64 bytes, Numbers kind) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;

  [[nodiscard]] std::vector<UsedUpload> take_used() { return std::move(used_); }
  void give_back(const Error& why) {
    if (may_be_sent_again(why)) arrays_.give_back(take_used());
  }

 private:
  SessionArrays& arrays_;
  std::vector<UsedUpload> used_;
};

}  // namespace heliograph::server
