// Who owns sessions, scenes and work, and what it may use. Asked by the gate.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "renderer/engine/job.h"
#include "server/assets.h"
#include "server/blobs.h"
#include "server/budget.h"
#include "server/config.h"
#include "server/identity.h"

namespace heliograph::server {

/// An owner with its quotas and its bytes. Thread: any.
class Tenant {
 public:
  /// `store`: the budget of all blobs, of which its own is a part.
  Tenant(u64 id, std::string name, const Limits& limits, const std::shared_ptr<Budget>& store);

  const u64 id;  // of this daemon's life
  const std::string name;
  const double weight = 1;                 // its share of the device against other tenants'
  const std::shared_ptr<Budget> bytes;     // of uploads, blobs, assets, inline arrays, events
  const std::shared_ptr<Budget> entities;  // of all its scenes
  const std::shared_ptr<Budget> streams;   // calls of Stream, RenderBatch and Watch
  const std::shared_ptr<Budget> jobs;      // that wait or run
  Rate edits;
  Rate samples;  // of all pixels
  // Its own: that another tenant has the same bytes cannot be seen.
  BlobStore blobs;
  AssetStore assets;

  [[nodiscard]] Origin origin(u64 session, i32 priority = 0) const {
    return {.tenant = id, .weight = weight, .session = session, .priority = priority};
  }
  /// What is used, by the limits' names.
  [[nodiscard]] std::map<std::string, u64> used() const;
};
using TenantPtr = std::shared_ptr<Tenant>;

/// The tenants of this daemon: identities are told apart here and nowhere else. Thread: any.
class Tenants {
 public:
  Tenants(const Limits& limits, Identities identities);

  /// UNAUTHENTICATED, in the same words whatever is missing or wrong.
  [[nodiscard]] Expected<TenantPtr> of(const Caller& caller) const;
  /// The tenant of that name, who may have no identity now: its durable scenes are there.
  [[nodiscard]] TenantPtr named(const std::string& name);
  /// From now on these identities hold. Returns the tenants that have none any more.
  [[nodiscard]] std::vector<TenantPtr> replace(Identities identities);
  /// Whether there is more than one.
  [[nodiscard]] bool are_several() const;
  [[nodiscard]] std::vector<TenantPtr> all() const;
  /// Of all blobs, uploads and assets.
  [[nodiscard]] const Budget& store() const { return *store_; }

 private:
  void add_tenants();  // those that identities_ names; under mutex_

  const Limits limits_;
  const std::shared_ptr<Budget> store_;
  mutable std::mutex mutex_;
  Identities identities_;
  std::map<std::string, TenantPtr> tenants_;
};

}  // namespace heliograph::server
