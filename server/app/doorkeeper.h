// Early authentication: a TCP call without an identity is refused by its headers. Used by
// grpc_server.cpp.
#pragma once

#include <grpcpp/security/auth_metadata_processor.h>

#include "server/access/tenant.h"
#include "server/observe/metrics.h"

namespace heliograph::server {

/// Called by gRPC once a call's headers have arrived, before it reads the message: strangers fill
/// no buffers. The gate checks again, with session and tenant. Thread: any.
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
