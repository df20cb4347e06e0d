// Limits of what a request lists. Used by the handlers, which know them.
#pragma once

#include "heliograph/v1/scene.pb.h"
#include "renderer/base/error.h"
#include "renderer/base/types.h"

namespace heliograph::server {

/// RESOURCE_EXHAUSTED, at "edits", when there are more than `most`.
[[nodiscard]] Status check_count(const v1::Transaction& message, u64 most);

}  // namespace heliograph::server
