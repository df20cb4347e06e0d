// See ledger.h.
#include "server/quota/ledger.h"

#include <limits>

namespace heliograph::server {
namespace {

/// A resource: its member, its limits, and the words of its refusals.
struct Resource {
  Ledger::BudgetPtr Ledger::* budget;
  u64 Limits::* total;   // null: limited per tenant only
  u64 Limits::* tenant;  // equal to `total` where a tenant may use all but the others' shares
  const char* total_name;
  const char* tenant_name;
  const char* unit;
  const char* remedy;
};

#define HELIO_TOTAL(name, unit, remedy) \
  {&Ledger::name, &Limits::name, &Limits::name, #name, #name, unit, remedy}

const Resource kResources[] = {
    {&Ledger::bytes, &Limits::blob_store_bytes, &Limits::tenant_bytes, "blob_store_bytes",
     "tenant_bytes", "bytes", "remove what is not used any more, close other sessions"},
    {&Ledger::jobs, &Limits::jobs, &Limits::tenant_jobs, "jobs", "tenant_jobs", "jobs",
     "wait for some to end"},
    HELIO_TOTAL(sessions, "sessions", "close one"),
    HELIO_TOTAL(scenes, "scenes", "delete one"),
    HELIO_TOTAL(quick_calls, "sockets for quick calls", "close sessions"),
    HELIO_TOTAL(descriptors, "descriptors", "let go of frames"),
    {&Ledger::entities, nullptr, &Limits::tenant_entities, "", "tenant_entities", "entities",
     "remove entities or scenes"},
    {&Ledger::streams, nullptr, &Limits::tenant_streams, "", "tenant_streams", "streams",
     "close a stream, a batch or a watch"},
    {&Ledger::disk, nullptr, &Limits::tenant_disk_bytes, "", "tenant_disk_bytes", "bytes of disk",
     "delete durable scenes or what is in them"},
};

#undef HELIO_TOTAL

}  // namespace

Ledger Ledger::of_all(const Limits& limits) {
  Ledger all;
  for (const Resource& each : kResources) {
    if (each.total == nullptr) continue;
    all.*each.budget = std::make_shared<Budget>(
        limits.*each.total, Budget::RefusalText{each.unit, each.remedy, each.total_name});
    (all.*each.budget)->set_parts(limits.reserved_parts);
  }
  all.bytes->set_overload(std::make_shared<const Overload>(Overload::Options{
      .percent = {limits.overload_sessions, limits.overload_uploads, limits.overload_jobs},
      .memory_bytes = limits.memory_bytes}));
  return all;
}

Ledger Ledger::of_tenant(const Limits& limits, const Ledger& all) {
  Ledger tenant;
  for (const Resource& each : kResources)
    tenant.*each.budget = std::make_shared<Budget>(
        limits.*each.tenant, Budget::RefusalText{each.unit, each.remedy, each.tenant_name},
        all.*each.budget);
  return tenant;
}

void Ledger::set_limits(const Limits& limits) {
  for (const Resource& each : kResources) (this->*each.budget)->set_limit(limits.*each.tenant);
}

void Ledger::set_totals(const Limits& limits) const {
  for (const Resource& each : kResources)
    if (each.total != nullptr) (this->*each.budget)->set_limit(limits.*each.total);
}

void Ledger::lift() const {
  for (const BudgetPtr& budget : list()) budget->set_limit(std::numeric_limits<u64>::max());
}

std::vector<Ledger::BudgetPtr> Ledger::list() const {
  std::vector<BudgetPtr> budgets;
  for (const Resource& each : kResources)
    if (this->*each.budget) budgets.push_back(this->*each.budget);
  return budgets;
}

}  // namespace heliograph::server
