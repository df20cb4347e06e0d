// Error to grpc::Status and google.rpc.Status.
#include "server/convert/error.h"

#include <fmt/format.h>

#include <cassert>
#include <cmath>

#include "google/rpc/error_details.pb.h"
#include "heliograph/v1/errors.pb.h"

namespace heliograph::server {
namespace {

// Our codes are gRPC's numbers.
static_assert(int(Code::kCancelled) == grpc::CANCELLED);
static_assert(int(Code::kUnknown) == grpc::UNKNOWN);
static_assert(int(Code::kInvalidArgument) == grpc::INVALID_ARGUMENT);
static_assert(int(Code::kDeadlineExceeded) == grpc::DEADLINE_EXCEEDED);
static_assert(int(Code::kNotFound) == grpc::NOT_FOUND);
static_assert(int(Code::kAlreadyExists) == grpc::ALREADY_EXISTS);
static_assert(int(Code::kPermissionDenied) == grpc::PERMISSION_DENIED);
static_assert(int(Code::kResourceExhausted) == grpc::RESOURCE_EXHAUSTED);
static_assert(int(Code::kFailedPrecondition) == grpc::FAILED_PRECONDITION);
static_assert(int(Code::kAborted) == grpc::ABORTED);
static_assert(int(Code::kOutOfRange) == grpc::OUT_OF_RANGE);
static_assert(int(Code::kUnimplemented) == grpc::UNIMPLEMENTED);
static_assert(int(Code::kInternal) == grpc::INTERNAL);
static_assert(int(Code::kUnavailable) == grpc::UNAVAILABLE);
static_assert(int(Code::kUnauthenticated) == grpc::UNAUTHENTICATED);

constexpr std::size_t kLongestMessage = 1536;
constexpr std::size_t kLongestPath = 512;
constexpr std::size_t kLongestLists = 1024;

/// Cuts to at most `bytes`, never within a UTF-8 character.
std::string cut(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  std::size_t end = bytes;
  while (end > 0 && (u8(text[end]) & 0xc0) == 0x80) --end;
  return text.substr(0, end) + "...";
}

/// Calls add(index, name) for as many of the first names as there is room for.
template <class Add>
void add_names(const std::vector<std::string>& names, std::size_t& room, const Add& add) {
  for (std::size_t i = 0; i < names.size() && names[i].size() <= room; ++i) {
    room -= names[i].size();
    add(i, names[i]);
  }
}

/// Returns the reason of an error that sets none.
const char* reason_of_code(const Error& error) {
  switch (error.code) {
    case Code::kCancelled:
      return "CANCELLED";
    case Code::kInvalidArgument:
      return "INVALID_VALUE";
    case Code::kDeadlineExceeded:
      return "DEADLINE_PASSED";
    case Code::kNotFound:
      return error.nearest.empty() ? "NOT_FOUND" : "UNKNOWN_NAME";
    case Code::kAlreadyExists:
      return "NAME_TAKEN";
    case Code::kPermissionDenied:
      return "NOT_PERMITTED";
    case Code::kResourceExhausted:
      if (error.retry_seconds > 0) return "BUSY";
      return error.limit.empty() && error.needed == 0 ? "NO_ROOM" : "LIMIT_EXCEEDED";
    case Code::kFailedPrecondition:
      return error.users.empty() ? "WRONG_STATE" : "IN_USE";
    case Code::kAborted:
      return "CONFLICT";
    case Code::kOutOfRange:
      return "REVISION_NOT_KEPT";
    case Code::kUnimplemented:
      return "NOT_IMPLEMENTED";
    case Code::kUnavailable:
      return "NOT_AVAILABLE";
    case Code::kUnauthenticated:
      return "NOT_IDENTIFIED";
    case Code::kInternal:
    case Code::kUnknown:
      break;
  }
  return "INTERNAL";
}

u64 allowed_by(const Error& error) { return error.allowed != 0 ? error.allowed : error.available; }

google::rpc::ErrorInfo to_info(const Error& error, std::size_t& room) {
  google::rpc::ErrorInfo info;
  info.set_reason(reason_of(error));
  info.set_domain("heliograph");
  auto& metadata = *info.mutable_metadata();
  if (!error.limit.empty()) metadata["limit"] = error.limit;
  if (error.needed > 0 || allowed_by(error) > 0) {
    metadata["needed"] = std::to_string(error.needed);
    metadata["used"] = std::to_string(allowed_by(error) - error.available);
    metadata["allowed"] = std::to_string(allowed_by(error));
  }
  if (error.expected > 0) metadata["expected"] = std::to_string(error.expected);
  add_names(error.nearest, room, [&](std::size_t i, const std::string& name) {
    metadata[fmt::format("nearest_{}", i)] = name;
  });
  return info;
}

google::rpc::BadRequest to_bad_request(const Error& error) {
  google::rpc::BadRequest bad;
  auto& violation = *bad.add_field_violations();
  violation.set_field(cut(error.where, kLongestPath));
  violation.set_reason(reason_of(error));
  return bad;
}

google::rpc::QuotaFailure to_quota_failure(const Error& error) {
  google::rpc::QuotaFailure failure;
  auto& violation = *failure.add_violations();
  violation.set_quota_metric(error.limit);
  violation.set_quota_value(i64(allowed_by(error)));
  return failure;
}

google::rpc::RetryInfo to_retry_info(const Error& error) {
  google::rpc::RetryInfo retry;
  double seconds;
  const double rest = std::modf(error.retry_seconds, &seconds);
  retry.mutable_retry_delay()->set_seconds(i64(seconds));
  retry.mutable_retry_delay()->set_nanos(int(rest * 1e9));
  return retry;
}

google::rpc::PreconditionFailure to_precondition_failure(const Error& error, std::size_t& room) {
  google::rpc::PreconditionFailure failure;
  add_names(error.users, room, [&](std::size_t, const std::string& name) {
    auto& violation = *failure.add_violations();
    violation.set_type("IN_USE");
    violation.set_subject(name);
  });
  return failure;
}

std::string message_of(const Error& error) {
  if (is_hidden(error)) return "an error inside the daemon; its log says more";
  const std::string text = error.where.empty() ? error.message : error.where + ": " + error.message;
  return cut(text, kLongestMessage);
}

}  // namespace

std::string reason_of(const Error& error) {
  std::string reason = error.reason.empty() ? reason_of_code(error) : error.reason;
  [[maybe_unused]] v1::ErrorReason known;
  assert(v1::ErrorReason_Parse("ERROR_REASON_" + reason, &known));
  return reason;
}

google::rpc::Status to_proto(const Error& error) {
  google::rpc::Status status;
  status.set_code(int(error.code));
  status.set_message(message_of(error));
  std::size_t room = kLongestLists;
  status.add_details()->PackFrom(to_info(error, room));
  if (!error.where.empty()) status.add_details()->PackFrom(to_bad_request(error));
  if (!error.limit.empty()) status.add_details()->PackFrom(to_quota_failure(error));
  if (error.retry_seconds > 0) status.add_details()->PackFrom(to_retry_info(error));
  if (!error.users.empty()) status.add_details()->PackFrom(to_precondition_failure(error, room));
  return status;
}

bool is_hidden(const Error& error) {
  return error.code == Code::kInternal || error.code == Code::kUnknown;
}

grpc::Status to_status(const Error& error, grpc::ServerContextBase& context) {
  const google::rpc::Status status = to_proto(error);
  if (is_hidden(error)) context.AddTrailingMetadata(kHiddenMessage, error.message);
  return {grpc::StatusCode(error.code), status.message(), status.SerializeAsString()};
}

grpc::Status to_status(const Status& status, grpc::ServerContextBase& context) {
  return status ? grpc::Status::OK : to_status(status.error(), context);
}

}  // namespace heliograph::server
