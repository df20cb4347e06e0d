// SHA-256 of blobs, assets and overlays. Used by the stores and by server/convert.
#pragma once

#include <google/protobuf/message_lite.h>

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace heliograph::server {

/// A digest over bytes that come in pieces.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void add(std::span<const std::byte> bytes);
  void add(std::string_view bytes);
  /// The 32 bytes; nothing may be added afterwards.
  [[nodiscard]] std::string finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

[[nodiscard]] std::string sha256(std::string_view bytes);
[[nodiscard]] std::string sha256(std::span<const std::byte> bytes);

/// The same bytes for equal messages, maps included.
[[nodiscard]] std::string serialize(const google::protobuf::MessageLite& message);

}  // namespace heliograph::server
