// TLS of the TCP listeners: the daemon's certificate and key, and the CA of clients' certificates.
// Made by lifecycle.cpp, used by grpc_server.cpp.
#pragma once

#include <grpcpp/security/server_credentials.h>

#include <memory>
#include <string>

#include "server/access/tenant.h"
#include "server/config/config.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Owns: copies of the files in memory, which gRPC reads again every second, so that a handshake
/// never combines a certificate with another one's key. Thread: the loop's.
class Tls {
 public:
  /// Loads the files of --tls-*. INVALID_ARGUMENT (no PEM, a key of another certificate),
  /// PERMISSION_DENIED (owned or writable by other users).
  [[nodiscard]] static Expected<std::unique_ptr<Tls>> load(const Config& config);

  /// Loads the files again; on failure the former ones stay in use.
  [[nodiscard]] Status reload();
  /// Returns credentials for TLS 1.2 and later. With --tls-client-ca a handshake needs a
  /// certificate that names one of `tenants`, which outlives them.
  [[nodiscard]] std::shared_ptr<grpc::ServerCredentials> credentials(const Tenants& tenants) const;

 private:
  explicit Tls(const Config& config) : config_(config) {}

  const Config config_;
  UniqueFd cert_;
  UniqueFd key_;
  UniqueFd client_ca_;
};

}  // namespace heliograph::server
