// Tenants and their quotas. See tenant.h.
#include "server/tenant.h"

namespace heliograph::server {

Tenant::Tenant(u64 number, std::string called, const Limits& limits,
               const std::shared_ptr<Budget>& store)
    : id(number),
      name(std::move(called)),
      bytes(std::make_shared<Budget>(
          limits.tenant_bytes,
          Budget::Words{"bytes", "remove what is not used any more, close other sessions",
                        "tenant_bytes"},
          store)),
      entities(std::make_shared<Budget>(
          limits.tenant_entities,
          Budget::Words{"entities", "remove entities or scenes", "tenant_entities"})),
      streams(std::make_shared<Budget>(
          limits.tenant_streams,
          Budget::Words{"streams", "close a stream, a batch or a watch", "tenant_streams"})),
      jobs(std::make_shared<Budget>(limits.tenant_jobs,
                                    Budget::Words{"jobs", "wait for some to end", "tenant_jobs"})),
      edits(limits.tenant_edits_per_second, "tenant_edits_per_second"),
      samples(limits.tenant_samples_per_second, "tenant_samples_per_second"),
      blobs({.bytes = limits.blob_store_bytes, .blob_bytes = limits.blob_bytes}, store) {}

std::map<std::string, u64> Tenant::used() const {
  std::map<std::string, u64> all;
  for (const auto& budget : {bytes, entities, streams, jobs}) all[budget->name()] = budget->used();
  return all;
}

Tenants::Tenants(const Limits& limits, Identities identities)
    : limits_(limits),
      store_(BlobStore::make_budget(limits.blob_store_bytes)),
      identities_(std::move(identities)) {
  add_tenants();
}

void Tenants::add_tenants() {
  for (const std::string& name : identities_.tenants())
    if (auto& tenant = tenants_[name]; !tenant)
      tenant = std::make_shared<Tenant>(tenants_.size(), name, limits_, store_);
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
  auto& tenant = tenants_[name];
  if (!tenant) tenant = std::make_shared<Tenant>(tenants_.size(), name, limits_, store_);
  return tenant;
}

std::vector<TenantPtr> Tenants::replace(Identities identities) {
  const std::lock_guard lock(mutex_);
  const auto before = identities_.tenants();
  identities_ = std::move(identities);
  add_tenants();
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
