// Channel arguments, limits and the health service. Called by main.
#include "server/grpc_server.h"

#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>

namespace heliograph::server {
namespace {

constexpr int kSendBytes = 64 << 20;
constexpr int kMaxThreads = 64;
constexpr const char* kRendererName = "heliograph.v1.Renderer";

void add_arguments(grpc::ServerBuilder& builder, const Limits& limits) {
  builder.SetMaxReceiveMessageSize(int(limits.message_bytes));
  builder.SetMaxSendMessageSize(kSendBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, int(limits.streams_per_connection));
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, 8 << 10);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, 5'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 20'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 5'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5'000);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, int(limits.chunk_bytes));
  grpc::ResourceQuota quota("heliographd");
  quota.Resize(limits.quota_bytes).SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
}

}  // namespace

Expected<std::unique_ptr<GrpcServer>> GrpcServer::start(Service& service, const Config& config) {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  add_arguments(builder, config.limits);
  builder.RegisterService(&service);
  std::unique_ptr<GrpcServer> made(new GrpcServer());
  using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  made->acceptor_ = builder.experimental().AddExternalConnectionAcceptor(
      Type::FROM_FD, grpc::InsecureServerCredentials());
  made->server_ = builder.BuildAndStart();
  if (!made->server_) return fail(Code::kInternal, "", "gRPC did not start");
  made->set_ready(false);
  return made;
}

void GrpcServer::serve(UniqueFd connection) {
  grpc::experimental::ExternalConnectionAcceptor::NewConnectionParameters parameters;
  parameters.fd = connection.release();
  acceptor_->HandleNewConnection(&parameters);
}

void GrpcServer::set_ready(bool is_ready) {
  server_->GetHealthCheckService()->SetServingStatus(kRendererName, is_ready);
}

void GrpcServer::shutdown(std::chrono::milliseconds grace) {
  server_->Shutdown(std::chrono::system_clock::now() + grace);
  server_->Wait();
}

}  // namespace heliograph::server
