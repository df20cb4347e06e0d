// Who owns sessions, scenes and work, and what it may use. Asked by the gate's callers.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "renderer/engine/job.h"
#include "server/budget.h"
#include "server/config.h"

namespace heliograph::server {

/// An owner with its quotas. Thread: any.
class Tenant {
 public:
  /// `store`: the budget of all blobs, of which its own is a part.
  Tenant(u64 id, const Limits& limits, std::shared_ptr<Budget> store);

  const u64 id;
  const double weight = 1;                 // its share of the device against other tenants'
  const std::shared_ptr<Budget> bytes;     // of uploads, blobs, assets and inline arrays
  const std::shared_ptr<Budget> entities;  // of all its scenes
  const std::shared_ptr<Budget> streams;   // calls of Stream and RenderBatch
  const std::shared_ptr<Budget> jobs;      // that wait or run
  Rate edits;
  Rate samples;  // of all pixels

  [[nodiscard]] Origin origin(u64 session, i32 priority = 0) const {
    return {.tenant = id, .weight = weight, .session = session, .priority = priority};
  }
  /// What is used, by the limits' names.
  [[nodiscard]] std::map<std::string, u64> used() const;
};
using TenantPtr = std::shared_ptr<Tenant>;

/// The tenants of this daemon. Today there is one: the user whose sockets these are. Identities
/// that differ (tokens, certificates) are told apart here and nowhere else.
class Tenants {
 public:
  Tenants(const Limits& limits, std::shared_ptr<Budget> store)
      : only_(std::make_shared<Tenant>(0, limits, std::move(store))) {}
  [[nodiscard]] const TenantPtr& of_caller() const { return only_; }

 private:
  const TenantPtr only_;
};

}  // namespace heliograph::server
