// Error to grpc::Status and ErrorDetail.
#include "server/convert/error.h"

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

constexpr std::size_t kLongestMessage = 2048;
constexpr std::size_t kLongestPath = 512;
constexpr std::size_t kLongestLists = 2048;

/// At most `bytes`, never within a UTF-8 character.
std::string cut(const std::string& text, std::size_t bytes) {
  if (text.size() <= bytes) return text;
  std::size_t end = bytes;
  while (end > 0 && (u8(text[end]) & 0xc0) == 0x80) --end;
  return text.substr(0, end) + "...";
}

template <class List>
void add(const std::vector<std::string>& names, std::size_t& room, List* list) {
  for (const std::string& name : names) {
    if (name.size() > room) return;
    room -= name.size();
    *list->Add() = name;
  }
}

}  // namespace

v1::ErrorDetail to_proto(const Error& error) {
  v1::ErrorDetail detail;
  detail.set_field(cut(error.where, kLongestPath));
  detail.set_needed(error.needed);
  detail.set_available(error.available);
  detail.set_expected(error.expected);
  detail.set_retry_seconds(error.retry_seconds);
  std::size_t room = kLongestLists;
  add(error.users, room, detail.mutable_users());
  add(error.nearest, room, detail.mutable_nearest());
  return detail;
}

bool is_hidden(const Error& error) {
  return error.code == Code::kInternal || error.code == Code::kUnknown;
}

std::string message_of(const Error& error) {
  if (is_hidden(error)) return "an error inside the daemon; its log says more";
  const std::string text = error.where.empty() ? error.message : error.where + ": " + error.message;
  return cut(text, kLongestMessage);
}

grpc::Status to_status(const Error& error, grpc::ServerContextBase& context) {
  context.AddTrailingMetadata("heliograph-error-bin", to_proto(error).SerializeAsString());
  if (is_hidden(error)) context.AddTrailingMetadata(kHiddenMessage, error.message);
  return {grpc::StatusCode(error.code), message_of(error)};
}

grpc::Status to_status(const Status& status, grpc::ServerContextBase& context) {
  return status ? grpc::Status::OK : to_status(status.error(), context);
}

}  // namespace heliograph::server
