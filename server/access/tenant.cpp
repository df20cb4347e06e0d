// Tenants and their quotas. See tenant.h.
#include "server/access/tenant.h"

namespace heliograph::server {

Tenant::Tenant(u64 number, std::string called, const Limits& limits, const Ledger& all)
    : id(number),
      name(std::move(called)),
      ledger(Ledger::of_tenant(limits, all)),
      edits(limits.tenant_edits_per_second, "tenant_edits_per_second"),
      samples(limits.tenant_samples_per_second, "tenant_samples_per_second"),
      blobs({.bytes = limits.blob_store_bytes,
             .blob_bytes = limits.blob_bytes,
             .window_bytes = limits.upload_window_bytes,
             .recent = {.seconds = limits.recent_seconds, .bytes = limits.recent_bytes}},
            ledger.bytes) {}

void Tenant::give(const Grant& grant) {
  weight_ = grant.weight;
  ledger.set_limits(grant.limits);
  edits.set_limit(grant.limits.tenant_edits_per_second);
  samples.set_limit(grant.limits.tenant_samples_per_second);
}

std::map<std::string, u64> Tenant::limits() const {
  std::map<std::string, u64> all;
  for (const auto& budget : ledger.list()) all[budget->name()] = budget->limit();
  for (const Rate* rate : {&edits, &samples}) all[rate->name()] = rate->limit();
  return all;
}

std::map<std::string, u64> Tenant::used() const {
  std::map<std::string, u64> all;
  for (const auto& budget : ledger.list()) all[budget->name()] = budget->used();
  return all;
}

Tenants::Tenants(const Limits& limits, Identities identities)
    : limits_(limits), all_(Ledger::of_all(limits)), identities_(std::move(identities)) {
  give_all();
}

TenantPtr& Tenants::give(const std::string& name) {
  auto& tenant = tenants_[name];
  if (!tenant) tenant = std::make_shared<Tenant>(tenants_.size(), name, limits_, all_);
  tenant->give(identities_.grant_of(name, limits_));
  return tenant;
}

void Tenants::give_all() {
  auto names = identities_.tenants();
  for (const auto& [name, tenant] : tenants_) names.insert(name);
  for (const std::string& name : names) give(name);
}

Expected<TenantPtr> Tenants::of(const Caller& caller) const {
  const std::lock_guard lock(mutex_);
  if (const std::string* name = identities_.tenant_of(caller)) return tenants_.at(*name);
  return fail(Code::kUnauthenticated, "",
              "the call does not say who makes it, or says it wrong: send a token as metadata "
              "'authorization: Bearer TOKEN', or connect with a client certificate; the daemon's "
              "operator has it (--tenants, or the file that --token-file names)");
}

TenantPtr Tenants::named(const std::string& name) {
  const std::lock_guard lock(mutex_);
  return give(name);
}

std::vector<TenantPtr> Tenants::replace(Identities identities) {
  const std::lock_guard lock(mutex_);
  const auto before = identities_.tenants();
  identities_ = std::move(identities);
  give_all();
  const auto now = identities_.tenants();
  std::vector<TenantPtr> gone;
  for (const std::string& name : before)
    if (!now.contains(name)) gone.push_back(tenants_.at(name));
  return gone;
}

std::vector<TenantPtr> Tenants::all() const {
  std::vector<TenantPtr> all;
  const std::lock_guard lock(mutex_);
  for (const auto& [name, tenant] : tenants_) all.push_back(tenant);
  return all;
}

bool Tenants::are_several() const {
  const std::lock_guard lock(mutex_);
  return tenants_.size() > 1;
}

}  // namespace heliograph::server
