// The uploads that one request used up. Used by the calls that read edits.
#pragma once

#include <string>
#include <vector>

#include "server/store/holdings.h"

namespace heliograph::server {

/// Whether a request that was refused so is sent again as it is: what it lacked is brought first,
/// or some time passes.
[[nodiscard]] inline bool may_be_sent_again(const Error& why) {
  return why.code == Code::kNotFound || why.retry_seconds > 0;
}

/// Gives what a session's holdings give. A request that may be sent again gives its uploads and
/// buffers back. Thread: one at a time.
class UsedUploads final : public ArraySource {
 public:
  explicit UsedUploads(Holdings& holdings) : holdings_(holdings) {}

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<bool> read(const v1::Array& array, u64 bytes,
                                    const TakePiece& take) override;
  [[nodiscard]] Expected<BufferPtr> take(const v1::Array& array, u64 bytes, Numbers kind) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;

  [[nodiscard]] std::vector<UsedUpload> take_used() { return std::move(used_); }
  void give_back(const Error& why) {
    if (may_be_sent_again(why)) holdings_.give_back(take_used());
  }

 private:
  Holdings& holdings_;
  std::vector<UsedUpload> used_;
};

}  // namespace heliograph::server
