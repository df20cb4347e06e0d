// The calls of the contract, as their log sees them.
#pragma once

#include <string_view>

#include "server/observe/call_record.h"

namespace heliograph::server {

/// What a request says, but for its metadata.
struct Asked {
  u64 bytes = 0;
  u64 scene = 0;  // 0: none
};

struct CallMethod {
  std::string_view name;
  Pace pace;
  Asked (*asked)(const void* request);
  bool gives_scene;  // its reply is a v1::SceneInfo
};

/// By the path that gRPC calls it by; null: it is none of Renderer's.
[[nodiscard]] const CallMethod* find_call_method(std::string_view path);

}  // namespace heliograph::server
