// Errors on their way out: the only translation to gRPC's status. Called by every handler.
#pragma once

#include <grpcpp/impl/codegen/server_context.h>
#include <grpcpp/support/status.h>

#include <string>

#include "google/rpc/status.pb.h"
#include "renderer/base/error.h"

namespace heliograph::server {

/// What a client is told, as errors.proto says. At most 4 KiB: long lists and messages are cut,
/// because metadata is limited; internal errors are not spelled out.
[[nodiscard]] google::rpc::Status to_proto(const Error& error);
/// Why, as the name of an ErrorReason without its prefix.
[[nodiscard]] std::string reason_of(const Error& error);
/// Whether the client is not told what it really was.
[[nodiscard]] bool is_hidden(const Error& error);
/// Trailing metadata that the call log takes out again: what an internal error really was.
inline constexpr const char* kHiddenMessage = "heliograph-hidden-message";
/// The status, with its details.
[[nodiscard]] grpc::Status to_status(const Error& error, grpc::ServerContextBase& context);
/// OK, or the above.
[[nodiscard]] grpc::Status to_status(const Status& status, grpc::ServerContextBase& context);

}  // namespace heliograph::server
