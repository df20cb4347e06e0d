// A client of the health service. Debian ships no health.proto; its two messages have one field
// each, written out here (https://github.com/grpc/grpc/blob/master/doc/health-checking.md).
#include "server/app/probe.h"

#include <fmt/format.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/generic/generic_stub.h>

#include <chrono>
#include <filesystem>
#include <future>

#include "server/app/grpc_server.h"

namespace heliograph::server {
namespace {

constexpr auto kPatience = std::chrono::seconds(2);
constexpr const char* kServing = "\x08\x01";  // status: SERVING

grpc::ByteBuffer check_request(const std::string& service) {
  const std::string bytes =
      service.empty() ? "" : fmt::format("\x0a{}{}", char(service.size()), service);
  const grpc::Slice slice(bytes);
  return {&slice, 1};
}

std::string bytes_of(const grpc::ByteBuffer& buffer) {
  grpc::Slice slice;
  if (!buffer.DumpToSingleSlice(&slice).ok()) return {};
  return {reinterpret_cast<const char*>(slice.begin()), slice.size()};
}

}  // namespace

int probe(const Config& config) {
  const std::string path = std::filesystem::absolute(config.socket).string();
  grpc::GenericStub stub(grpc::CreateChannel("unix://" + path, grpc::InsecureChannelCredentials()));
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + kPatience);
  const grpc::ByteBuffer request = check_request(config.probe == "ready"     ? kRendererName
                                                 : config.probe == "durable" ? kDurableName
                                                                             : "");
  grpc::ByteBuffer reply;
  std::promise<grpc::Status> done;
  stub.UnaryCall(&context, "/grpc.health.v1.Health/Check", grpc::StubOptions(), &request, &reply,
                 [&done](grpc::Status status) { done.set_value(std::move(status)); });
  const grpc::Status status = done.get_future().get();
  if (status.ok() && bytes_of(reply) == kServing) return kExitOk;
  fmt::print(stderr, "heliographd: --probe: not {}{}{}\n", config.probe, status.ok() ? "" : ": ",
             status.error_message());
  return kExitNotHealthy;
}

}  // namespace heliograph::server
