// Errors on their way out: the only translation to gRPC's status. Called by every handler.
#pragma once

#include <grpcpp/impl/codegen/server_context.h>
#include <grpcpp/support/status.h>

#include "heliograph/v1/types.pb.h"
#include "renderer/base/error.h"

namespace heliograph::server {

/// Where and what, at most 4 KiB: long lists are cut, because metadata is limited.
[[nodiscard]] v1::ErrorDetail to_proto(const Error& error);
/// What a client may read: internal errors are not spelled out, messages are cut at 2 KiB.
[[nodiscard]] std::string message_of(const Error& error);
/// Whether the client is not told what it really was.
[[nodiscard]] bool is_hidden(const Error& error);
/// Trailing metadata that the call log takes out again: what an internal error really was.
inline constexpr const char* kHiddenMessage = "heliograph-hidden-message";
/// The status; adds the ErrorDetail to the call's trailing metadata as "heliograph-error-bin".
[[nodiscard]] grpc::Status to_status(const Error& error, grpc::ServerContextBase& context);
/// OK, or the above.
[[nodiscard]] grpc::Status to_status(const Status& status, grpc::ServerContextBase& context);

}  // namespace heliograph::server
