// Budgets by resource: one ledger per tenant, and one of totals. Whoever takes something holds a
// Charge. A tenant's is in tenant.h.
#pragma once

#include <memory>
#include <vector>

#include "server/config/config.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// A set of budgets. Thread: any.
struct Ledger {
  using BudgetPtr = std::shared_ptr<Budget>;
  BudgetPtr bytes;        // in memory for clients: uploads, arrays, attributes, requests
  BudgetPtr jobs;         // jobs and queries, waiting or running
  BudgetPtr sessions;     // open sessions
  BudgetPtr scenes;       // existing scenes
  BudgetPtr quick_calls;  // sessions with a socket for quick calls
  BudgetPtr descriptors;  // descriptors of frames in shared memory and of quick calls
  BudgetPtr entities;     // entities of all scenes; per tenant only
  BudgetPtr streams;      // calls of Stream, RenderBatch and Watch; per tenant only
  BudgetPtr disk;         // bytes of durable scenes; per tenant only

  /// Makes the totals, which tenants share.
  [[nodiscard]] static Ledger of_all(const Limits& limits);
  /// Makes a tenant's budgets, parts of the totals.
  [[nodiscard]] static Ledger of_tenant(const Limits& limits, const Ledger& all);
  /// Sets the limits of a tenant's budgets.
  void set_limits(const Limits& limits);
  /// Sets the limits of the totals.
  void set_totals(const Limits& limits) const;
  /// Lifts the limits of the totals until set_totals().
  void lift() const;
  /// Returns the budgets that are not null.
  [[nodiscard]] std::vector<BudgetPtr> list() const;
};

}  // namespace heliograph::server
