// Who owns sessions, scenes and work, and what it may use. Asked by the gate.
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
  /// all   totals, of which its own ledger is a part
  Tenant(u64 id, std::string name, const Limits& limits, const Ledger& all);

  /// From now on this holds. What is used stays used; the weight counts for next jobs.
  void give(const Grant& grant);

  const u64 id;  // of this daemon's life
  const std::string name;
  Ledger ledger;  // const but for its limits
  Rate edits;
  Rate samples;  // of all pixels
  // Its own: that another tenant has the same bytes cannot be seen.
  BlobStore blobs;
  AssetStore assets;

  [[nodiscard]] Origin origin(u64 session, u64 scene, i32 priority = 0) const {
    return {
        .tenant = id, .weight = weight_, .session = session, .scene = scene, .priority = priority};
  }
  /// Its share of the device against other tenants'.
  [[nodiscard]] double weight() const { return weight_; }
  /// By their names.
  [[nodiscard]] std::map<std::string, u64> limits() const;
  /// What is used, by the limits' names.
  [[nodiscard]] std::map<std::string, u64> used() const;

 private:
  std::atomic<double> weight_ = 1;
};
using TenantPtr = std::shared_ptr<Tenant>;

/// The tenants of this daemon: identities are told apart here and nowhere else. Thread: any.
class Tenants {
 public:
  Tenants(const Limits& limits, Identities identities);

  /// UNAUTHENTICATED, in the same words whatever is missing or wrong.
  [[nodiscard]] Expected<TenantPtr> of(const Caller& caller) const;
  /// The tenant of that name, who has what it is given from now on; it may have no identity, only
  /// durable scenes.
  [[nodiscard]] TenantPtr named(const std::string& name);
  /// From now on these identities and grants hold. Returns the tenants that have none any more.
  [[nodiscard]] std::vector<TenantPtr> replace(Identities identities);
  /// Whether there is more than one.
  [[nodiscard]] bool are_several() const;
  [[nodiscard]] std::vector<TenantPtr> all() const;
  /// What all use together.
  [[nodiscard]] const Ledger& ledger() const { return all_; }

 private:
  // Both under mutex_.
  TenantPtr& give(const std::string& name);  // the tenant, made if need be, has its grant
  void give_all();                           // those that identities_ names, and that were there

  const Limits limits_;
  const Ledger all_;
  mutable std::mutex mutex_;
  Identities identities_;
  std::map<std::string, TenantPtr> tenants_;
};

}  // namespace heliograph::server
