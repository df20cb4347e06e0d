// Identity before bytes: who has none over TCP is refused by the headers of a call. Used by
// grpc_server.cpp.
#pragma once

#include <grpcpp/security/auth_metadata_processor.h>

#include "server/access/tenant.h"
#include "server/observe/metrics.h"

namespace heliograph::server {

/// Asked by gRPC once the headers of a call are there, before it reads a byte of its message: so a
/// stranger fills none of its buffers. The gate decides again, by session and tenant. Thread: any.
class Doorkeeper final : public grpc::AuthMetadataProcessor {
 public:
  Doorkeeper(const Tenants& tenants, Metrics& metrics) : tenants_(tenants), metrics_(metrics) {}

  [[nodiscard]] bool IsBlocking() const override { return false; }
  grpc::Status Process(const InputMetadata& metadata, grpc::AuthContext* context,
                       OutputMetadata* consumed, OutputMetadata* response) override;

 private:
  const Tenants& tenants_;
  Metrics& metrics_;
};

}  // namespace heliograph::server
