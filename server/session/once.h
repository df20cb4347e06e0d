// Calls with a request_id: executed once, answered again from memory.
#pragma once

#include <string>

#include "server/session/request_log.h"

namespace heliograph::server {

struct OnceKey {
  RequestLog& log;
  const std::string& request_id;
  const char* method;
};

/// Fills `reply` from memory, or from make() -> Expected<Reply>.
template <class Reply, class Make>
[[nodiscard]] Status once(const OnceKey& key, Reply& reply, const Make& make) {
  const auto known = key.log.begin(key.request_id, key.method);
  if (!known) return std::unexpected(known.error());
  if (*known) {
    reply.ParseFromString(**known);
    return {};
  }
  auto made = make();
  key.log.finish(key.request_id, made ? std::optional(made->SerializeAsString()) : std::nullopt);
  if (!made) return std::unexpected(made.error());
  reply = std::move(*made);
  return {};
}

}  // namespace heliograph::server
