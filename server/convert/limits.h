// Checks of counts and sizes in requests. Used by the handlers.
#pragma once

#include <string_view>

#include "heliograph/v1/scene.pb.h"
#include "renderer/base/error.h"
#include "renderer/base/types.h"

namespace heliograph::server {

/// Checks the number of edits. RESOURCE_EXHAUSTED, at "edits", when there are more than `most`.
[[nodiscard]] Status check_count(const v1::Transaction& message, u64 most);
/// Checks a request id. INVALID_ARGUMENT, at "request_id", when it has more than 256 bytes.
[[nodiscard]] Status check_request_id(std::string_view id);

}  // namespace heliograph::server
