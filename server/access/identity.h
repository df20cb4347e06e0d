// What the tenants file says: who a caller is, by token, certificate and Unix socket, and what a
// tenant is given. Read by main, at start and when the file changes; asked by Tenants.
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

/// What is known of who makes a call. Views live as long as the call.
struct Caller {
  bool is_local = false;                  // over the Unix socket
  std::string_view token;                 // "": none was sent
  std::vector<std::string_view> names{};  // of its certificate
};

/// What a tenant is given.
struct Grant {
  double weight = 1;  // its share of the device against other tenants'
  Limits limits;      // those of a tenant, tenant_*
};

/// Tokens, certificate names and the Unix socket, each with the name of its tenant. Tokens are held
/// as their SHA-256.
class Identities {
 public:
  /// Lines `TENANT token sha256:HEX`, `TENANT certificate NAME`, `TENANT socket`,
  /// `TENANT weight NUMBER`, `TENANT limit NAME NUMBER`; `#` starts a comment. INVALID_ARGUMENT
  /// with the line's number, never with what is in it.
  [[nodiscard]] static Expected<Identities> parse(std::string_view text);

  /// `hash`: SHA-256 of the token, 32 bytes. ALREADY_EXISTS when another tenant has it.
  [[nodiscard]] Status add_token(const std::string& hash, const std::string& tenant);
  [[nodiscard]] Status add_certificate(const std::string& name, const std::string& tenant);
  [[nodiscard]] Status set_socket(const std::string& tenant);

  /// The tenant's name: by the token if one was sent; else by the certificate; else by the socket.
  /// Null: nobody's, or of names of several tenants.
  [[nodiscard]] const std::string* tenant_of(const Caller& caller) const;
  [[nodiscard]] std::set<std::string> tenants() const;
  /// What its lines say; where they say nothing, weight 1 and these limits.
  [[nodiscard]] Grant grant_of(const std::string& tenant, const Limits& limits) const;

 private:
  /// What the lines of one tenant say of its grant.
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

/// What the tenants file says; without one, all who may use the socket or know the token of
/// --token-file are one tenant, "local".
[[nodiscard]] Expected<Identities> load_identities(const Config& config);

}  // namespace heliograph::server
