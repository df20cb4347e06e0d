// Converts google.rpc.Status to ClientError; proto/heliograph/v1/errors.proto describes its
// details.
#include <cstdlib>

#include "google/rpc/error_details.pb.h"
#include "wire/session.h"

namespace heliograph::client::wire {
namespace {

std::uint64_t number(const google::rpc::ErrorInfo& info, const char* name) {
  const auto found = info.metadata().find(name);
  return found == info.metadata().end() ? 0 : std::strtoull(found->second.c_str(), nullptr, 10);
}

void take(const google::rpc::ErrorInfo& info, ErrorDetails* out) {
  out->reason = info.reason();
  if (const auto limit = info.metadata().find("limit"); limit != info.metadata().end())
    out->limit = limit->second;
  out->needed = number(info, "needed");
  out->used = number(info, "used");
  out->allowed = number(info, "allowed");
  out->expected = number(info, "expected");
  for (int i = 0;; ++i) {
    const auto name = info.metadata().find("nearest_" + std::to_string(i));
    if (name == info.metadata().end()) return;
    out->nearest.push_back(name->second);
  }
}

void take(const google::rpc::BadRequest& bad, ErrorDetails* out) {
  if (!bad.field_violations().empty()) out->field = bad.field_violations(0).field();
}

void take(const google::rpc::RetryInfo& retry, ErrorDetails* out) {
  out->retry_seconds = double(retry.retry_delay().seconds()) + retry.retry_delay().nanos() * 1e-9;
}

void take(const google::rpc::PreconditionFailure& failure, ErrorDetails* out) {
  for (const auto& violation : failure.violations())
    if (violation.type() == "IN_USE") out->users.push_back(violation.subject());
}

template <class Detail>
void take_if(const google::protobuf::Any& any, ErrorDetails* out) {
  Detail detail;
  if (any.Is<Detail>() && any.UnpackTo(&detail)) take(detail, out);
}

}  // namespace

ClientError to_error(const google::rpc::Status& status) {
  ErrorDetails details;
  for (const google::protobuf::Any& any : status.details()) {
    take_if<google::rpc::ErrorInfo>(any, &details);
    take_if<google::rpc::BadRequest>(any, &details);
    take_if<google::rpc::RetryInfo>(any, &details);
    take_if<google::rpc::PreconditionFailure>(any, &details);
  }
  const Code code{status.code()};
  std::string text = status.message().empty() ? name_of(code) : status.message();
  if (text.find("message larger than max") != std::string::npos) {  // gRPC's own words
    details.field = "message";
    text =
        "message: " + text + "; split it into several, or raise the daemon's limit message_bytes";
  }
  return {code, text, std::move(details)};
}

}  // namespace heliograph::client::wire
