// The one error type: codes equal gRPC's numbers, `where` points at the offending field.
#pragma once

#include <expected>
#include <string>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

enum class Code : int {
  kCancelled = 1,
  kUnknown = 2,
  kInvalidArgument = 3,
  kDeadlineExceeded = 4,
  kNotFound = 5,
  kAlreadyExists = 6,
  kPermissionDenied = 7,
  kResourceExhausted = 8,
  kFailedPrecondition = 9,
  kAborted = 10,
  kOutOfRange = 11,
  kUnimplemented = 12,
  kInternal = 13,
  kUnavailable = 14,
  kUnauthenticated = 16,
};

struct Error {
  Code code = Code::kUnknown;
  std::string message;                 // names the remedy
  std::string where;                   // path in the request: "edits[3].mesh.indices"; may be empty
  std::vector<std::string> users{};    // who still refers to the object
  std::vector<std::string> nearest{};  // the nearest names
  std::string reason{};                // "STALE_EDIT"; empty: the one that follows from the rest
  std::string limit{};                 // the limit that is in the way, by its name
  u64 needed = 0;                      // what the request needs of it, and
  u64 available = 0;                   // what is left of it, in the unit that the message names
  u64 allowed = 0;                     // the limit itself; 0: `available`, as nothing is used
  u64 expected = 0;                    // a number of an edit, or a revision
  double retry_seconds = 0;            // when it may work; 0: not known

  /// Prefixes the path: at("edits[3]") turns "mesh.indices" into "edits[3].mesh.indices", and
  /// at("ids") turns "[7]" into "ids[7]".
  [[nodiscard]] Error at(const std::string& prefix) && {
    where = where.empty() || where.front() == '[' ? prefix + where : prefix + "." + where;
    return std::move(*this);
  }
};

template <class T>
using Expected = std::expected<T, Error>;
using Status = std::expected<void, Error>;

[[nodiscard]] inline std::unexpected<Error> fail(Code code, std::string where,
                                                 std::string message) {
  return std::unexpected(
      Error{.code = code, .message = std::move(message), .where = std::move(where)});
}

}  // namespace heliograph

/// Returns the error of a Status or Expected expression to the caller, if it has one.
#define HELIO_TRY(expression)                                  \
  do {                                                         \
    if (auto helio_status = (expression); !helio_status)       \
      return std::unexpected(std::move(helio_status).error()); \
  } while (false)
