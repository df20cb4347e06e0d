// What the journal holds becomes scenes again. Called once by the daemon's start.
#pragma once

#include <map>
#include <set>

#include "server/access/tenant.h"
#include "server/journal/journal.h"
#include "server/scene/scenes.h"

namespace heliograph::server {

/// What recovery fills, and where it takes room.
struct RecoveryTarget {
  Scenes& scenes;
  Tenants& tenants;
};
struct Recovered {
  u64 scenes = 0;
  u64 records = 0;                    // applied after the snapshots
  std::map<u64, TenantPtr> sessions;  // with edits that are kept, or with private scenes
  std::set<u64> owners;               // of private scenes
  u64 saved = 0;                      // scenes that were saved by the daemon before
  u64 dropped = 0;                    // that were, and cannot be had
  Status because;                     // why the last of these not
};

/// Fails with INTERNAL, naming what is damaged, and RESOURCE_EXHAUSTED when a limit was lowered.
[[nodiscard]] Expected<Recovered> recover(Journal& journal, const RecoveryTarget& target);

}  // namespace heliograph::server
