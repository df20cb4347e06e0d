// Tenants: owners of sessions, scenes and work, and their quotas. Used by the gate.
#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "renderer/frame/job.h"
#include "server/access/identity.h"
#include "server/config/config.h"
#include "server/quota/ledger.h"
#include "server/store/assets.h"
#include "server/store/blobs.h"

namespace heliograph::server {

/// An owner with its quotas and its bytes. Thread: any.
class Tenant {
 public:
  /// all   the totals that its ledger is a part of
  Tenant(u64 id, std::string name, const Limits& limits, const Ledger& all);

  /// Sets its grant. Amounts in use stay; the weight applies to later jobs.
  void give(const Grant& grant);

  const u64 id;  // unique until the daemon ends
  const std::string name;
  Ledger ledger;  // constant but for the limits
  Rate edits;
  Rate samples;  // samples per second, over all pixels
  // Per tenant, so that a tenant cannot learn that another has the same bytes.
  BlobStore blobs;
  AssetStore assets;

  [[nodiscard]] Origin origin(u64 session, u64 scene, i32 priority = 0) const {
    return {
        .tenant = id, .weight = weight_, .session = session, .scene = scene, .priority = priority};
  }
  /// Returns its share of the device relative to other tenants'.
  [[nodiscard]] double weight() const { return weight_; }
  /// Returns its limits by name.
  [[nodiscard]] std::map<std::string, u64> limits() const;
  /// Returns the amounts in use, by the limits' names.
  [[nodiscard]] std::map<std::string, u64> used() const;

 private:
  std::atomic<double> weight_ = 1;
};
using TenantPtr = std::shared_ptr<Tenant>;

/// The tenants of this daemon; the only place that maps identities to them. Thread: any.
class Tenants {
 public:
  Tenants(const Limits& limits, Identities identities);

  /// Returns the caller's tenant. UNAUTHENTICATED, with one message for every reason.
  [[nodiscard]] Expected<TenantPtr> of(const Caller& caller) const;
  /// Returns the tenant of that name with its present grant, making it if need be: it may have
  /// durable scenes and no identity.
  [[nodiscard]] TenantPtr named(const std::string& name);
  /// Replaces identities and grants. Returns the tenants that no longer have an identity.
  [[nodiscard]] std::vector<TenantPtr> replace(Identities identities);
  /// Returns true when there is more than one tenant.
  [[nodiscard]] bool are_several() const;
  [[nodiscard]] std::vector<TenantPtr> all() const;
  /// Returns the totals.
  [[nodiscard]] const Ledger& ledger() const { return all_; }

 private:
  // Both under mutex_.
  TenantPtr& give(const std::string& name);  // finds or makes the tenant and applies its grant
  void give_all();                           // to tenants that identities_ names, and existing ones

  const Limits limits_;
  const Ledger all_;
  mutable std::mutex mutex_;
  Identities identities_;
  std::map<std::string, TenantPtr> tenants_;
};

}  // namespace heliograph::server
