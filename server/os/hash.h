// SHA-256 of blobs, assets and overlays. Used by the stores and by server/convert.
#pragma once

#include <google/protobuf/message_lite.h>

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace heliograph::server {

/// An incremental digest.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void add(std::span<const std::byte> bytes);
  void add(std::string_view bytes);
  /// Returns the digest, 32 bytes. No add() may follow.
  [[nodiscard]] std::string finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

[[nodiscard]] std::string sha256(std::string_view bytes);
[[nodiscard]] std::string sha256(std::span<const std::byte> bytes);

/// Serialises deterministically: equal messages give equal bytes, maps included.
[[nodiscard]] std::string serialize(const google::protobuf::MessageLite& message);

}  // namespace heliograph::server
