// Channel arguments, limits and the health service. Called by main.
#include "server/app/grpc_server.h"

#include <grpc/grpc.h>
#include <grpc/support/log.h>
#include <grpc/support/time.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/resource_quota.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <atomic>

#include "server/app/doorkeeper.h"
#include "server/observe/call_log.h"
#include "server/observe/record_calls.h"

namespace heliograph::server {
namespace {

constexpr int kSendBytes = 64 << 20;
constexpr int kMaxThreads = 64;
constexpr int kHandshakeMs = 4'000;  // timeout of the TLS and HTTP/2 handshakes

void add_arguments(grpc::ServerBuilder& builder, const Limits& limits, u64 quota_bytes) {
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
  quota.Resize(quota_bytes).SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
}

std::atomic<const Log*> log_of_grpc = nullptr;  // the daemon's log, while a server exists

/// Returns true for a connection to 127.0.0.1 or ::1.
bool is_first_loopback(int connection) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  if (::getsockname(connection, reinterpret_cast<sockaddr*>(&storage), &size) != 0) return false;
  if (storage.ss_family == AF_INET)
    return reinterpret_cast<const sockaddr_in*>(&storage)->sin_addr.s_addr ==
           htonl(INADDR_LOOPBACK);
  return storage.ss_family == AF_INET6 &&
         IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6*>(&storage)->sin6_addr);
}

/// Passes gRPC's log to the daemon's: gRPC's own would write to stderr and may block.
void write_log(gpr_log_func_args* line) {
  const Log* log = log_of_grpc;
  if (log) log->warning("gRPC", {{"says", line->message}, {"file", line->file}});
}

std::unique_ptr<grpc::experimental::ExternalConnectionAcceptor> add_acceptor(
    grpc::ServerBuilder& builder, const GrpcServer::Credentials& credentials) {
  using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
  return builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, credentials);
}

}  // namespace

Expected<std::unique_ptr<GrpcServer>> GrpcServer::start_local(Daemon& daemon) {
  std::unique_ptr<GrpcServer> made(new GrpcServer(daemon));
  grpc::ServerBuilder builder;
  made->acceptor_ = add_acceptor(builder, grpc::InsecureServerCredentials());
  HELIO_TRY(made->build(builder, daemon, daemon.config.limits.quota_bytes));
  return made;
}

Expected<std::unique_ptr<GrpcServer>> GrpcServer::start_tcp(Daemon& daemon, Credentials tls) {
  std::unique_ptr<GrpcServer> made(new GrpcServer(daemon));
  grpc::ServerBuilder builder;
  // The only plain TCP credentials that ask an auth processor; they accept connections to 127.0.0.1
  // and ::1.
  Credentials guarded =
      tls ? std::move(tls) : grpc::experimental::LocalServerCredentials(LOCAL_TCP);
  guarded->SetAuthMetadataProcessor(std::make_shared<Doorkeeper>(daemon.tenants, daemon.metrics));
  made->acceptor_ = add_acceptor(builder, guarded);
  if (daemon.config.tls_cert.empty())
    made->exposed_ = add_acceptor(builder, grpc::InsecureServerCredentials());
  HELIO_TRY(made->build(builder, daemon, daemon.config.limits.tcp_quota_bytes));
  return made;
}

Status GrpcServer::build(grpc::ServerBuilder& builder, Daemon& daemon, u64 quota_bytes) {
  // Never shut down: gRPC's shutdown waits up to 10 s for a polling thread.
  ::grpc_init();
  log_of_grpc = &daemon.log;
  ::gpr_set_log_function(write_log);
  grpc::EnableDefaultHealthCheckService(true);
  add_arguments(builder, daemon.config.limits, quota_bytes);
  builder.RegisterService(&service_);
  if (daemon.config.reflection) {
    reflection_ = std::make_unique<Reflection>(daemon.gate);
    builder.RegisterService(reflection_.get());
  }
  std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> observers;
  if (daemon.recorder) observers.push_back(std::make_unique<RecordCalls>(*daemon.recorder));
  observers.push_back(std::make_unique<ObserveCalls>(daemon.call_log));
  builder.SetContextAllocator(std::make_unique<RecordedContexts>());
  builder.experimental().SetInterceptorCreators(std::move(observers));
  server_ = builder.BuildAndStart();
  if (!server_) return fail(Code::kInternal, "", "gRPC did not start");
  set_ready(false);
  if (daemon.journal) set_durable(bool(daemon.journal->status()));
  return {};
}

GrpcServer::~GrpcServer() { log_of_grpc = nullptr; }

void GrpcServer::serve(UniqueFd connection) {
  Acceptor* acceptor =
      exposed_ && !is_first_loopback(connection.get()) ? exposed_.get() : acceptor_.get();
  Acceptor::NewConnectionParameters parameters;
  parameters.fd = connection.release();
  acceptor->HandleNewConnection(&parameters);
}

void GrpcServer::set(const char* name, bool is_serving) {
  server_->GetHealthCheckService()->SetServingStatus(name, is_serving);
}
void GrpcServer::set_ready(bool is_ready) { set(kRendererName, is_ready); }
void GrpcServer::set_live(bool is_live) { set("", is_live); }
void GrpcServer::set_durable(bool is_writing) { set(kDurableName, is_writing); }

void GrpcServer::shutdown(std::chrono::milliseconds grace) {
  server_->Shutdown(gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC),
                                 gpr_time_from_millis(grace.count(), GPR_TIMESPAN)));
  server_->Wait();
}

}  // namespace heliograph::server
