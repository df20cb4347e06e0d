// The uploads that one request used up. Used by the calls that read edits.
#pragma once

#include <string>
#include <vector>

#include "server/store/holdings.h"

namespace heliograph::server {

/// Gives what a session's holdings give. A request that is refused gives its uploads and buffers
/// back, for it is sent again with the same. Thread: one at a time.
class UsedUploads final : public ArraySource {
 public:
  explicit UsedUploads(Holdings& holdings) : holdings_(holdings) {}

  [[nodiscard]] Expected<BufferPtr> bytes(const v1::Array& array) override;
  [[nodiscard]] Expected<bool> read(const v1::Array& array, u64 bytes,
                                    const TakePiece& take) override;
  [[nodiscard]] Expected<BufferPtr> take(const v1::Array& array, u64 bytes, Numbers kind) override;
  [[nodiscard]] Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override;

  [[nodiscard]] std::vector<UsedUpload> take_used() { return std::move(used_); }
  void give_back() { holdings_.give_back(take_used()); }

 private:
  Holdings& holdings_;
  std::vector<UsedUpload> used_;
};

}  // namespace heliograph::server
