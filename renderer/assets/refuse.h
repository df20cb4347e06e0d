// How loaders refuse a file: one exception type, thrown only inside renderer/assets and caught only
// by load_asset(). Used by every loader.
#pragma once

#include <fmt/format.h>

#include <string>
#include <utility>

#include "renderer/base/error.h"

namespace heliograph::assets {

struct Refused {
  Error error;
  bool is_option = false;  // it is the request's, whatever is in the file
};

/// where   element of the file: "accessors[3].count", "line 17"
/// message the rule broken and the remedy
[[noreturn]] inline void refuse(std::string where, std::string message,
                                Code code = Code::kInvalidArgument) {
  throw Refused{Error{.code = code, .message = std::move(message), .where = std::move(where)}};
}

/// Refuses a field of LoadOptions.
[[noreturn]] inline void refuse_option(std::string name, std::string message,
                                       Code code = Code::kInvalidArgument) {
  throw Refused{.error = {.code = code, .message = std::move(message), .where = std::move(name)},
                .is_option = true};
}

[[noreturn]] inline void refuse_unimplemented(std::string where, std::string message) {
  refuse(std::move(where), std::move(message), Code::kUnimplemented);
}

}  // namespace heliograph::assets
