// The calls of the contract, as the call log sees them.
#pragma once

#include <string_view>

#include "server/observe/call_record.h"

namespace heliograph::server {

/// Facts of a request, without its metadata.
struct Asked {
  u64 bytes = 0;
  u64 scene = 0;  // 0: none
};

struct CallMethod {
  std::string_view name;
  Pace pace;
  Asked (*asked)(const void* request);
  bool gives_scene;  // the reply is a v1::SceneInfo
};

/// Finds a call by its gRPC path; null: none of Renderer's.
[[nodiscard]] const CallMethod* find_call_method(std::string_view path);

}  // namespace heliograph::server
