// Recovers scenes from the journal. Called once, when the daemon starts.
#pragma once

#include <map>
#include <set>

#include "server/access/tenant.h"
#include "server/journal/journal.h"
#include "server/scene/scenes.h"

namespace heliograph::server {

/// Destination of recovery, and the budgets it charges.
struct RecoveryTarget {
  Scenes& scenes;
  Tenants& tenants;
};
struct Recovered {
  u64 scenes = 0;
  u64 records = 0;                    // applied after the snapshots
  std::map<u64, TenantPtr> sessions;  // sessions with kept edits or private scenes
  std::set<u64> owners;               // sessions with private scenes
  u64 saved = 0;                      // scenes that the previous daemon saved
  u64 dropped = 0;                    // saved scenes that could not be recovered
  Status because;                     // reason of the last one dropped
};

/// Recovers all scenes. INTERNAL names what is damaged; RESOURCE_EXHAUSTED when a limit was
/// lowered.
[[nodiscard]] Expected<Recovered> recover(Journal& journal, const RecoveryTarget& target);

}  // namespace heliograph::server
