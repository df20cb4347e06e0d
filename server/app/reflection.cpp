// Descriptors of heliograph.v1 on request. See reflection.h.
#include "server/app/reflection.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/descriptor.pb.h>

#include <set>

#include "heliograph/v1/service.pb.h"
#include "server/calls/rpc.h"

namespace heliograph::server {
namespace {

namespace pb = google::protobuf;
using Request = Reflection::Request;
using Response = Reflection::Response;

const pb::FileDescriptor& contract() { return *v1::GetServerInfoRequest::descriptor()->file(); }

/// Returns the file if it belongs to the contract or to the details of its errors, else null.
const pb::FileDescriptor* if_ours(const pb::FileDescriptor* file) {
  const bool is_ours = file != nullptr &&
                       (file->package() == contract().package() || file->package() == "google.rpc");
  return is_ours ? file : nullptr;
}

/// Finds the file of a service, message or enum of the contract by its full name.
const pb::FileDescriptor* file_of(const std::string& symbol) {
  return if_ours(contract().pool()->FindFileContainingSymbol(symbol));
}

const pb::FileDescriptor* file_named(const std::string& name) {
  return if_ours(contract().pool()->FindFileByName(name));
}

void add_files(const pb::FileDescriptor& file, std::set<std::string>& seen,
               grpc::reflection::v1alpha::FileDescriptorResponse& reply) {
  if (!seen.insert(file.name()).second) return;
  pb::FileDescriptorProto proto;
  file.CopyTo(&proto);
  reply.add_file_descriptor_proto(proto.SerializeAsString());
  for (int i = 0; i < file.dependency_count(); ++i) add_files(*file.dependency(i), seen, reply);
}

void describe(const pb::FileDescriptor* file, Response& reply) {
  if (file == nullptr) {
    reply.mutable_error_response()->set_error_code(grpc::NOT_FOUND);
    reply.mutable_error_response()->set_error_message("not a part of heliograph.v1");
    return;
  }
  std::set<std::string> seen;
  add_files(*file, seen, *reply.mutable_file_descriptor_response());
}

Response answer(const Request& request) {
  Response reply;
  reply.set_valid_host(request.host());
  *reply.mutable_original_request() = request;
  switch (request.message_request_case()) {
    case Request::kListServices:
      for (int i = 0; i < contract().service_count(); ++i)
        reply.mutable_list_services_response()->add_service()->set_name(
            contract().service(i)->full_name());
      return reply;
    case Request::kFileByFilename:
      describe(file_named(request.file_by_filename()), reply);
      return reply;
    case Request::kFileContainingSymbol:
      describe(file_of(request.file_containing_symbol()), reply);
      return reply;
    default:  // the contract has no extensions
      describe(nullptr, reply);
      return reply;
  }
}

class Conversation final : public grpc::ServerBidiReactor<Request, Response> {
 public:
  Conversation() { StartRead(&request_); }
  void OnReadDone(bool ok) override {
    if (!ok) return Finish(grpc::Status::OK);
    reply_ = answer(request_);
    StartWrite(&reply_);
  }
  void OnWriteDone(bool ok) override {
    if (!ok) return Finish(grpc::Status::CANCELLED);
    StartRead(&request_);
  }
  void OnDone() override { delete this; }

 private:
  Request request_;
  Response reply_;
};

}  // namespace

grpc::ServerBidiReactor<Request, Response>* Reflection::ServerReflectionInfo(
    grpc::CallbackServerContext* context) {
  const auto admitted = gate_.admit(*context, Needs::kNothing);
  if (!admitted)
    return new Refusal<grpc::ServerBidiReactor<Request, Response>>(*context, admitted.error());
  return new Conversation();
}

}  // namespace heliograph::server
