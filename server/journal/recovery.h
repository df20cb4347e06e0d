// What the journal holds becomes scenes again. Called once by the daemon's start.
#pragma once

#include <map>

#include "server/journal/journal.h"
#include "server/scenes.h"
#include "server/tenant.h"

namespace heliograph::server {

/// What recovery fills, and where it takes room.
struct RecoveryTarget {
  Scenes& scenes;
  Tenants& tenants;
};
struct Recovered {
  u64 scenes = 0;
  u64 records = 0;                    // applied after the snapshots
  std::map<u64, TenantPtr> sessions;  // with edits that are kept
};

/// Fails with INTERNAL, naming what is damaged, and RESOURCE_EXHAUSTED when a limit was lowered.
[[nodiscard]] Expected<Recovered> recover(Journal& journal, const RecoveryTarget& target);

}  // namespace heliograph::server
