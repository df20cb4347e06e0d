// What the container or the machine gives this process, and limits that fit it. Called by
// lifecycle.cpp.
#pragma once

#include <string>
#include <vector>

#include "server/config/config.h"

namespace heliograph::server {

/// The least memory limit of the process's cgroup and those above it, version 1 or 2.
///
/// own   what /proc/self/cgroup says
/// root  where cgroups are mounted: /sys/fs/cgroup
/// Returns the largest u64 where there is no limit.
[[nodiscard]] u64 cgroup_memory(const std::string& own, const std::string& root);

/// Processors that the quotas of the cgroup and those above it make, rounded up, version 1 or 2.
/// The largest u64 where there is no quota.
[[nodiscard]] u64 cgroup_cores(const std::string& own, const std::string& root);

struct Machine {
  u64 memory = 0;       // bytes: the cgroup's, or the machine's where that is less
  u64 descriptors = 0;  // RLIMIT_NOFILE
  u64 cores = 1;        // that this process may run on, or its quota where that is less
};
/// Raises the soft limit of descriptors to the hard one.
[[nodiscard]] Machine this_machine();

/// A limit that was larger than its part of what there is.
struct Fitted {
  std::string name;
  u64 from = 0;
  u64 to = 0;
  bool is_kept = false;  // the operator set it, so it stays what it was
};
/// Lowers limits that nobody set to their part of the machine: the parts of one kind add up to what
/// there is. `connections` is lowered in any case, because more cannot be open. Sets `threads`
/// where nobody did: all cores, or of 8 and more all but one, for what is quick.
[[nodiscard]] std::vector<Fitted> fit(Config& config, const Machine& machine);

}  // namespace heliograph::server
