// The tenants file: which tenant a caller belongs to, by token, certificate or Unix socket, and
// what a tenant is granted. Read by main at the start and when the file changes; used by Tenants.
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/error.h"
#include "server/config/config.h"

namespace heliograph::server {

/// Identity of the maker of a call. The views live as long as the call.
struct Caller {
  bool is_local = false;                  // came over the Unix socket
  std::string_view token;                 // "": none was sent
  std::vector<std::string_view> names{};  // names of its certificate
};

/// Grant of a tenant.
struct Grant {
  double weight = 1;  // its share of the device against other tenants'
  Limits limits;      // only the limits of a tenant, tenant_*, apply
};

/// Map of tokens, certificate names and the Unix socket to names of tenants. Tokens are kept as
/// their SHA-256.
class Identities {
 public:
  /// Parses lines `TENANT token sha256:HEX`, `TENANT certificate NAME`, `TENANT socket`, `TENANT
  /// weight NUMBER`, `TENANT limit NAME NUMBER`; `#` starts a comment. INVALID_ARGUMENT names the
  /// line's number, never its content.
  [[nodiscard]] static Expected<Identities> parse(std::string_view text);

  /// Adds a token by its SHA-256, 32 bytes. ALREADY_EXISTS when another tenant has it.
  [[nodiscard]] Status add_token(const std::string& hash, const std::string& tenant);
  [[nodiscard]] Status add_certificate(const std::string& name, const std::string& tenant);
  [[nodiscard]] Status set_socket(const std::string& tenant);

  /// Returns the tenant's name: by the token if one was sent, else by the certificate, else by the
  /// socket. Null when none matches, or the certificate's names match several tenants.
  [[nodiscard]] const std::string* tenant_of(const Caller& caller) const;
  [[nodiscard]] std::set<std::string> tenants() const;
  /// Returns a tenant's grant; defaults are weight 1 and `limits`.
  [[nodiscard]] Grant grant_of(const std::string& tenant, const Limits& limits) const;

 private:
  /// Grant of one tenant as its lines give it.
  struct Lines {
    std::optional<double> weight;
    std::vector<LimitSetting> limits;
  };
  [[nodiscard]] Status add_line(std::string_view line);
  [[nodiscard]] Status set_weight(std::string_view number, const std::string& tenant);
  [[nodiscard]] Status set_limit(std::string_view name, std::string_view number,
                                 const std::string& tenant);

  std::map<std::string, std::string> tokens_;
  std::map<std::string, std::string, std::less<>> certificates_;
  std::string socket_;
  std::map<std::string, Lines> lines_;
};

/// Loads the tenants file; without one, all callers that may use the socket or have the token of
/// --token-file are one tenant, "local".
[[nodiscard]] Expected<Identities> load_identities(const Config& config);

}  // namespace heliograph::server
