// Quotas of a tenant. See tenant.h.
#include "server/tenant.h"

namespace heliograph::server {

Tenant::Tenant(u64 tenant, const Limits& limits, std::shared_ptr<Budget> store)
    : id(tenant),
      bytes(std::make_shared<Budget>(
          limits.tenant_bytes,
          Budget::Words{"bytes", "remove what is not used any more, close other sessions",
                        "tenant_bytes"},
          std::move(store))),
      entities(std::make_shared<Budget>(
          limits.tenant_entities,
          Budget::Words{"entities", "remove entities or scenes", "tenant_entities"})),
      streams(std::make_shared<Budget>(
          limits.tenant_streams,
          Budget::Words{"streams", "close a stream or a batch", "tenant_streams"})),
      jobs(std::make_shared<Budget>(limits.tenant_jobs,
                                    Budget::Words{"jobs", "wait for some to end", "tenant_jobs"})),
      edits(limits.tenant_edits_per_second, "tenant_edits_per_second"),
      samples(limits.tenant_samples_per_second, "tenant_samples_per_second") {}

std::map<std::string, u64> Tenant::used() const {
  std::map<std::string, u64> all;
  for (const auto& budget : {bytes, entities, streams, jobs}) all[budget->name()] = budget->used();
  return all;
}

}  // namespace heliograph::server
