// Conversion of errors to gRPC status, the only place that does it. Called by every handler.
#pragma once

#include <grpcpp/impl/codegen/server_context.h>
#include <grpcpp/support/status.h>

#include <string>

#include "google/rpc/status.pb.h"
#include "renderer/base/error.h"

namespace heliograph::server {

/// Returns the status sent to the client, as errors.proto states. At most 4 KiB, since metadata is
/// limited: long lists and messages are cut. Internal errors are not spelled out.
[[nodiscard]] google::rpc::Status to_proto(const Error& error);
/// Returns the reason, the name of an ErrorReason without its prefix.
[[nodiscard]] std::string reason_of(const Error& error);
/// Returns true when the true message is hidden from the client.
[[nodiscard]] bool is_hidden(const Error& error);
/// Trailing metadata that carries the hidden message of an internal error to the call log, which
/// removes it.
inline constexpr const char* kHiddenMessage = "heliograph-hidden-message";
/// Returns the status with its details.
[[nodiscard]] grpc::Status to_status(const Error& error, grpc::ServerContextBase& context);
/// Returns OK, or the status of the error.
[[nodiscard]] grpc::Status to_status(const Status& status, grpc::ServerContextBase& context);

}  // namespace heliograph::server
