// Resources of the container or machine, and limits that fit them. Called by lifecycle.cpp.
#pragma once

#include <string>
#include <vector>

#include "server/config/config.h"

namespace heliograph::server {

/// Returns the smallest memory limit of the process's cgroup and its ancestors, in bytes, version 1
/// or 2; the largest u64 where there is none.
///
/// own   content of /proc/self/cgroup
/// root  where cgroups are mounted: /sys/fs/cgroup
[[nodiscard]] u64 cgroup_memory(const std::string& own, const std::string& root);

/// Returns the CPU quota of the process's cgroup and its ancestors in cores, rounded up, version 1
/// or 2; the largest u64 where there is none.
[[nodiscard]] u64 cgroup_cores(const std::string& own, const std::string& root);

struct Machine {
  u64 memory = 0;       // bytes: the cgroup's, or the machine's where that is less
  u64 descriptors = 0;  // RLIMIT_NOFILE
  u64 cores = 1;        // that this process may run on, or its quota where that is less
};
/// Measures this process's resources, after raising the soft limit of descriptors to the hard one.
[[nodiscard]] Machine this_machine();

/// A limit that exceeded its part of the machine.
struct Fitted {
  std::string name;
  u64 from = 0;
  u64 to = 0;
  bool is_kept = false;  // the operator set it, so it stays what it was
};
/// Lowers limits that the operator left at their defaults to their part of the machine: parts of
/// one kind add up to the whole. `connections` is lowered even if set, since more cannot be open.
/// Sets `threads` where it is 0: all cores, from 8 on all but one.
[[nodiscard]] std::vector<Fitted> fit(Config& config, const Machine& machine);

}  // namespace heliograph::server
