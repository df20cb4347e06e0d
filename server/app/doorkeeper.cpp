// See doorkeeper.h.
#include "server/app/doorkeeper.h"

#include "server/session/gate.h"

namespace heliograph::server {

grpc::Status Doorkeeper::Process(const InputMetadata& metadata, grpc::AuthContext* context,
                                 OutputMetadata* /*consumed*/, OutputMetadata* /*response*/) {
  Caller caller{.names = names_of(*context)};
  if (const auto found = metadata.find("authorization"); found != metadata.end())
    caller.token = token_of({found->second.data(), found->second.size()});
  const auto tenant = tenants_.of(caller);
  if (tenant) return grpc::Status::OK;
  metrics_.identity_refused();
  return {grpc::UNAUTHENTICATED, tenant.error().message};
}

}  // namespace heliograph::server
