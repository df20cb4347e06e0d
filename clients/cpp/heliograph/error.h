// The client's only exception: a refusal of the daemon or the client, with its reason.
#pragma once

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace heliograph::client {

/// gRPC's codes and numbers; docs/protocol.md states what each means.
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

/// "NOT_FOUND"
std::string name_of(Code code);

/// More about an error, where there is more.
struct ErrorDetails {
  std::string field;           // path of the offending value: "edits[3].mesh.indices"
  std::string reason{};        // docs/protocol.md lists them: "LIMIT_EXCEEDED"; "": gRPC's own
  std::string limit{};         // the limit that is in the way, by its name
  std::uint64_t needed = 0;    // kResourceExhausted: amount needed,
  std::uint64_t used = 0;      // amount in use, and
  std::uint64_t allowed = 0;   // the limit, in the unit that the message names
  std::uint64_t expected = 0;  // kAborted: the edit number or revision expected;
                               // kOutOfRange: the nearest revision that there is
  double retry_seconds = 0;    // when the same call may work; 0: not known
  std::vector<std::string> users{};    // kFailedPrecondition: who still refers to the object
  std::vector<std::string> nearest{};  // kNotFound: the nearest names
  std::optional<int> exit_code{};      // of a private daemon that died; negative: the signal
  std::vector<std::string> log{};      // its last 20 lines
};

/// Exception of every call of the client; there is no other. what() names the field, the fault, and
/// after a semicolon the remedy.
class ClientError : public std::runtime_error {
 public:
  ClientError(Code code, const std::string& message, ErrorDetails details = {})
      : std::runtime_error(message), code_(code), details_(std::move(details)) {}

  [[nodiscard]] Code code() const noexcept { return code_; }
  [[nodiscard]] const std::string& field() const noexcept { return details_.field; }
  [[nodiscard]] const std::string& reason() const noexcept { return details_.reason; }
  [[nodiscard]] const ErrorDetails& details() const noexcept { return details_; }

  /// Remedy: the message from its first semicolon on, or all of it without one.
  [[nodiscard]] std::string remedy() const;

 private:
  Code code_;
  ErrorDetails details_;
};

}  // namespace heliograph::client
