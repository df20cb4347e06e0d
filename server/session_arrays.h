// Where the arrays of a session's requests come from. Used by Apply and Render.
#pragma once

#include "server/convert/transaction.h"
#include "server/daemon.h"

namespace heliograph::server {

class SessionArrays final : public ArraySource {
 public:
  SessionArrays(Daemon&, Session&) {}
  Expected<BufferPtr> bytes(const v1::Array& array) override {
    if (array.source_case() != v1::Array::kInline)
      return fail(Code::kUnimplemented, "", "only inline arrays are served yet");
    const std::string& in = array.inline_();
    auto owner = std::make_shared<std::vector<std::byte>>(in.size());
    std::memcpy(owner->data(), in.data(), in.size());
    return std::make_shared<const Buffer>(owner, std::span(*owner));
  }
  Expected<std::shared_ptr<const Asset>> asset(std::string_view) override {
    return fail(Code::kUnimplemented, "asset", "assets are not served yet");
  }
  Expected<BufferPtr> blob(std::string_view) override {
    return fail(Code::kUnimplemented, "blob", "blobs are not served yet");
  }
  void consume() {}
};

}  // namespace heliograph::server
