// A gRPC server without listeners: connections come from our accept loop.
#pragma once

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include <memory>

#include "server/app/reflection.h"
#include "server/calls/service.h"
#include "server/config/config.h"
#include "server/os/accept.h"

namespace heliograph::server {

/// Name of readiness in the health service; "" is liveness.
inline constexpr const char* kRendererName = "heliograph.v1.Renderer";

/// Name in the health service of whether durable scenes accept edits; unknown to it where there can
/// be none.
inline constexpr const char* kDurableName = "heliograph.v1.Durable";

/// Owns: a gRPC server and its threads. The Unix socket and TCP have one each, because buffer
/// limits are per server: filling TCP's buffers ends no local connection. Thread: the loop's,
/// unless stated.
class GrpcServer {
 public:
  /// Credentials of TCP connections: null: no TLS.
  using Credentials = std::shared_ptr<grpc::ServerCredentials>;

  /// Starts a server. INTERNAL when gRPC does not start.
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start_local(Daemon& daemon);
  [[nodiscard]] static Expected<std::unique_ptr<GrpcServer>> start_tcp(Daemon& daemon,
                                                                       Credentials tls);
  ~GrpcServer();

  void serve(UniqueFd connection);
  /// Set the health service's status of "heliograph.v1.Renderer", of "", and of
  /// "heliograph.v1.Durable". Thread: any.
  void set_ready(bool is_ready);
  void set_live(bool is_live);
  void set_durable(bool is_writing);
  /// Ends the server; calls still running after `grace` are cancelled.
  void shutdown(std::chrono::milliseconds grace);

 private:
  using Acceptor = grpc::experimental::ExternalConnectionAcceptor;

  explicit GrpcServer(Daemon& daemon) : service_(daemon) {}
  [[nodiscard]] Status build(grpc::ServerBuilder& builder, Daemon& daemon, u64 quota_bytes);
  void set(const char* name, bool is_serving);

  Service service_;
  std::unique_ptr<Reflection> reflection_;
  // The acceptors must outlive the server.
  std::unique_ptr<Acceptor> acceptor_;
  std::unique_ptr<Acceptor> exposed_;  // TCP without TLS at addresses other than loopback
  std::unique_ptr<grpc::Server> server_;
};

}  // namespace heliograph::server
