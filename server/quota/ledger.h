// What may be in use at a time, resource by resource: of a tenant, and of all in total. Each tenant
// has one (tenant.h); whoever takes something holds a Charge.
#pragma once

#include <memory>
#include <vector>

#include "server/config/config.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Thread: any.
struct Ledger {
  using BudgetPtr = std::shared_ptr<Budget>;
  BudgetPtr bytes;        // that clients caused to be kept: uploads, arrays, attributes, requests
  BudgetPtr jobs;         // and queries, that wait or run
  BudgetPtr sessions;     // open
  BudgetPtr scenes;       // there
  BudgetPtr quick_calls;  // sessions that have a socket for them
  BudgetPtr descriptors;  // of frames in shared memory and of these sockets
  BudgetPtr entities;     // of all scenes; a tenant's alone
  BudgetPtr streams;      // calls of Stream, RenderBatch and Watch; a tenant's alone
  BudgetPtr disk;         // bytes of durable scenes; a tenant's alone

  /// The totals, which tenants share.
  [[nodiscard]] static Ledger of_all(const Limits& limits);
  /// A tenant's part of them.
  [[nodiscard]] static Ledger of_tenant(const Limits& limits, const Ledger& all);
  /// From now on these hold for a tenant.
  void set_limits(const Limits& limits);
  /// The same for the totals.
  void set_totals(const Limits& limits) const;
  /// Totals have no limits until set_totals().
  void lift() const;
  /// Those that there are.
  [[nodiscard]] std::vector<BudgetPtr> list() const;
};

}  // namespace heliograph::server
