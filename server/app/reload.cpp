// See reload.h.
#include "server/app/reload.h"

#include <sys/prctl.h>
#include <sys/resource.h>

namespace heliograph::server {
namespace {

std::vector<std::string> named(std::initializer_list<std::string> paths) {
  std::vector<std::string> kept;
  for (const std::string& path : paths)
    if (!path.empty()) kept.push_back(path);
  return kept;
}

void log_kept(const Daemon& daemon, const Error& error) {
  daemon.log.error("not taken; what held goes on",
                   {{"flag", error.where}, {"reason", error.message}});
}

void reload_tenants(Daemon& daemon) {
  auto identities = load_identities(daemon.config);
  if (!identities) return log_kept(daemon, identities.error());
  for (const TenantPtr& tenant : daemon.tenants.replace(std::move(*identities)))
    daemon.sessions.close_of(*tenant);
  daemon.log.info("tenants read again");
}

}  // namespace

Reload::Reload(const Config& config)
    : tenants_(named({config.tenants_file})),
      tls_(named({config.tls_cert, config.tls_key, config.tls_client_ca})) {}

void Reload::start(Daemon& daemon, Tls* tls) {
  tenants_.start(*daemon.loop, [&daemon] { reload_tenants(daemon); });
  tls_.start(*daemon.loop, [&daemon, tls] {
    if (auto taken = tls->reload(); !taken) return log_kept(daemon, taken.error());
    daemon.log.info("certificates read again");
  });
}

void hide_memory() {
  ::prctl(PR_SET_DUMPABLE, 0);
  const rlimit none{};
  ::setrlimit(RLIMIT_CORE, &none);
}

}  // namespace heliograph::server
