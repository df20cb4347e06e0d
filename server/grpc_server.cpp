// Channel arguments, limits and the health service. Called by main.
#include "server/grpc_server.h"

#include <grpc/grpc.h>
#include <grpc/support/log.h>
#include <grpc/support/time.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>

#include <atomic>

#include "server/call_log.h"
#include "server/record_calls.h"

namespace heliograph::server {
namespace {

constexpr int kSendBytes = 64 << 20;
constexpr int kMaxThreads = 64;
constexpr int kHandshakeMs = 4'000;  // of TLS and HTTP/2

void add_arguments(grpc::ServerBuilder& builder, const Limits& limits) {
  builder.SetMaxReceiveMessageSize(int(limits.message_bytes));
  builder.SetMaxSendMessageSize(kSendBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, int(limits.streams_per_connection));
  builder.AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, 8 << 10);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 20'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 5'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5'000);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, int(limits.chunk_bytes));
  grpc::ResourceQuota quota("heliographd");
  quota.Resize(limits.quota_bytes).SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
}

std::atomic<const Log*> log_of_grpc = nullptr;  // of the daemon, while there is a server

/// Its own writes to stderr, and waits for whoever reads it.
void write_log(gpr_log_func_args* line) {
  const Log* log = log_of_grpc;
  if (log) log->warning("gRPC", {{"says", line->message}, {"file", line->file}});
}

}  // namespace

Expected<std::unique_ptr<GrpcServer>> GrpcServer::start(Service& service, Daemon& daemon,
                                                        const Credentials& tcp) {
  // Never undone: gRPC's own end waits for a thread that polls for up to 10 s.
  ::grpc_init();
  log_of_grpc = &daemon.log;
  ::gpr_set_log_function(write_log);
  grpc::EnableDefaultHealthCheckService(true);
  grpc::ServerBuilder builder;
  add_arguments(builder, daemon.config.limits);
  builder.RegisterService(&service);
  std::unique_ptr<GrpcServer> made(new GrpcServer());
  if (daemon.config.reflection) {
    made->reflection_ = std::make_unique<Reflection>(daemon.gate);
    builder.RegisterService(made->reflection_.get());
  }
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> observers;
  if (daemon.recorder) observers.push_back(std::make_unique<RecordCalls>(*daemon.recorder));
  observers.push_back(std::make_unique<CallLog>(daemon.log, daemon.metrics));
  builder.experimental().SetInterceptorCreators(std::move(observers));
  using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  made->local_ = builder.experimental().AddExternalConnectionAcceptor(
      Type::FROM_FD, grpc::InsecureServerCredentials());
  made->tcp_ = builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, tcp);
  made->server_ = builder.BuildAndStart();
  if (!made->server_) return fail(Code::kInternal, "", "gRPC did not start");
  made->set_ready(false);
  if (daemon.journal) {
    daemon.journal_changed = [health = made->server_->GetHealthCheckService()](bool is_writing) {
      health->SetServingStatus(kDurableName, is_writing);
    };
    daemon.journal_changed(bool(daemon.journal->status()));
  }
  return made;
}

GrpcServer::~GrpcServer() { log_of_grpc = nullptr; }

void GrpcServer::serve(Acceptor& acceptor, UniqueFd connection) {
  Acceptor::NewConnectionParameters parameters;
  parameters.fd = connection.release();
  acceptor.HandleNewConnection(&parameters);
}

void GrpcServer::set_ready(bool is_ready) {
  server_->GetHealthCheckService()->SetServingStatus(kRendererName, is_ready);
}

void GrpcServer::set_live(bool is_live) {
  server_->GetHealthCheckService()->SetServingStatus("", is_live);
}

void GrpcServer::shutdown(std::chrono::milliseconds grace) {
  server_->Shutdown(gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC),
                                 gpr_time_from_millis(grace.count(), GPR_TIMESPAN)));
  server_->Wait();
}

}  // namespace heliograph::server
