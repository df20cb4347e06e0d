// See container.h.
#include "server/config/container.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <tbb/info.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <limits>
#include <sstream>
#include <utility>

namespace heliograph::server {
namespace {

constexpr u64 kNoLimit = std::numeric_limits<u64>::max();
constexpr u64 kOwnDescriptors = 64;     // of gRPC, the decoder, the journal, logs, metrics
constexpr u64 kFewDescriptors = 8;      // at least, left to frames
constexpr u64 kDescriptorsAClient = 3;  // its connection, our duplicate, its local channel
constexpr u64 kManyCores = 8;

/// Reads a number from a kernel file; "max" or a missing file: no limit.
u64 number_in(const std::string& path) {
  std::ifstream file(path);
  std::string text;
  file >> text;
  u64 number = kNoLimit;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), number);
  return parsed.ec == std::errc() ? number : kNoLimit;
}

u64 cores_of(u64 quota, u64 period) {
  return quota == kNoLimit || period == 0 ? kNoLimit
                                          : std::max<u64>(1, (quota + period - 1) / period);
}
/// Parses "max 100000" or "150000 100000", quota and period in microseconds, into cores.
u64 cores_in(const std::string& path) {
  std::ifstream file(path);
  u64 quota = 0, period = 0;
  return file >> quota >> period ? cores_of(quota, period) : kNoLimit;
}

/// Returns the smallest value of a group and its ancestors.
template <class Read>
u64 least_upwards(const std::string& root, std::string group, const Read& read) {
  u64 least = read(root);
  while (!group.empty() && group != "/") {
    least = std::min(least, read(root + group));
    group.resize(group.rfind('/') == std::string::npos ? 0 : group.rfind('/'));
  }
  return least;
}

/// How to read one controller's limit from a group's folder, cgroup version 1 or 2.
struct Controller {
  const char* name;
  u64 (*now)(const std::string& folder);
  u64 (*version_1)(const std::string& folder);
};
constexpr Controller kMemory{
    "memory", [](const std::string& f) { return number_in(f + "/memory.max"); },
    [](const std::string& f) { return number_in(f + "/memory.limit_in_bytes"); }};
constexpr Controller kCores{"cpu", [](const std::string& f) { return cores_in(f + "/cpu.max"); },
                            [](const std::string& f) {
                              return cores_of(number_in(f + "/cpu.cfs_quota_us"),
                                              number_in(f + "/cpu.cfs_period_us"));
                            }};

/// own   lines of NUMBER:CONTROLLERS:GROUP
u64 least_of(const Controller& controller, const std::string& own, const std::string& root) {
  u64 least = kNoLimit;
  std::istringstream lines(own);
  for (std::string line; std::getline(lines, line);) {
    const auto first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string names = fmt::format(",{},", line.substr(first + 1, second - first - 1));
    const std::string group = line.substr(second + 1);
    if (names == ",,")
      least = std::min(least, least_upwards(root, group, controller.now));
    else if (names.find(fmt::format(",{},", controller.name)) != std::string::npos)
      least = std::min(least, least_upwards(fmt::format("{}/{}", root, controller.name), group,
                                            controller.version_1));
  }
  return least;
}

struct Share {
  const char* name;
  u64 Limits::* limit;
  u64 parts;  // of the memory, in 32nds
};
// blob_store, derived, frame, shared and both quotas make 24; decoders have half of the memory as
// address space, of which they seldom use much.
constexpr Share kShares[] = {
    {"blob_store_bytes", &Limits::blob_store_bytes, 12},
    {"tenant_bytes", &Limits::tenant_bytes, 12},
    {"blob_bytes", &Limits::blob_bytes, 8},
    {"array_bytes", &Limits::array_bytes, 8},
    {"derived_bytes", &Limits::derived_bytes, 4},
    {"frame_bytes", &Limits::frame_bytes, 4},
    {"shared_bytes", &Limits::shared_bytes, 2},
    {"recent_bytes", &Limits::recent_bytes, 1},
    {"quota_bytes", &Limits::quota_bytes, 1},
    {"tcp_quota_bytes", &Limits::tcp_quota_bytes, 1},
    {"decode_bytes", &Limits::decode_bytes, 8},
    {"decode_result_bytes", &Limits::decode_result_bytes, 4},
};

/// Lowers limits and records each change.
class Fitting {
 public:
  explicit Fitting(Config& config) : config_(config) {}

  /// Lowers a limit to `most`. False when it was lower already, or set by the operator.
  bool lower(const char* name, u64 Limits::* limit, u64 most) {
    const bool is_kept = config_.limits_set.contains(name);
    const u64 from = config_.limits.*limit;
    if (from <= most) return false;
    if (!is_kept) config_.limits.*limit = most;
    all_.push_back({.name = name, .from = from, .to = most, .is_kept = is_kept});
    return !is_kept;
  }
  void lower_anyway(const char* name, u64 Limits::* limit, u64 most) {
    const u64 from = config_.limits.*limit;
    if (from <= most) return;
    config_.limits.*limit = most;
    all_.push_back({.name = name, .from = from, .to = most});
  }
  [[nodiscard]] std::vector<Fitted> all() && { return std::move(all_); }

 private:
  Config& config_;
  std::vector<Fitted> all_;
};

void fit_memory(Fitting& fitting, const Limits& limits, u64 machine) {
  fitting.lower("memory_bytes", &Limits::memory_bytes, machine);
  const u64 memory = limits.memory_bytes;
  for (const Share& each : kShares) fitting.lower(each.name, each.limit, memory / 32 * each.parts);
  if (fitting.lower("decodes", &Limits::decodes,
                    std::max<u64>(2, memory / 2 / limits.decode_bytes)))
    fitting.lower("decodes_per_tenant", &Limits::decodes_per_tenant, limits.decodes - 1);
}

void fit_descriptors(Fitting& fitting, const Limits& limits, u64 machine) {
  const u64 spare = machine > 2 * kOwnDescriptors ? machine - kOwnDescriptors : machine / 2;
  const u64 connections = std::max<u64>(spare / 8 * 7 / kDescriptorsAClient, 4);
  fitting.lower_anyway("connections", &Limits::connections, connections);
  const u64 taken = kOwnDescriptors + kDescriptorsAClient * limits.connections;
  fitting.lower("descriptors", &Limits::descriptors,
                machine > taken + kFewDescriptors ? machine - taken : kFewDescriptors);
}

/// Returns the number of render threads: from 8 cores on, one core stays free, since threads that
/// answer calls would wait for the scheduler.
u32 threads_of(u64 cores) { return u32(cores < kManyCores ? cores : cores - 1); }

}  // namespace

u64 cgroup_memory(const std::string& own, const std::string& root) {
  return least_of(kMemory, own, root);
}

u64 cgroup_cores(const std::string& own, const std::string& root) {
  return least_of(kCores, own, root);
}

Machine this_machine() {
  std::ifstream file("/proc/self/cgroup");
  std::ostringstream own;
  own << file.rdbuf();
  const u64 machine = u64(::sysconf(_SC_PHYS_PAGES)) * u64(::sysconf(_SC_PAGESIZE));
  rlimit files{};
  ::getrlimit(RLIMIT_NOFILE, &files);
  files.rlim_cur = files.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &files);
  ::getrlimit(RLIMIT_NOFILE, &files);
  return {.memory = std::min(machine, cgroup_memory(own.str(), "/sys/fs/cgroup")),
          .descriptors = files.rlim_cur,
          .cores = std::min(u64(tbb::info::default_concurrency()),
                            cgroup_cores(own.str(), "/sys/fs/cgroup"))};
}

std::vector<Fitted> fit(Config& config, const Machine& machine) {
  Fitting fitting(config);
  fit_memory(fitting, config.limits, machine.memory);
  fit_descriptors(fitting, config.limits, machine.descriptors);
  if (config.threads == 0) config.threads = threads_of(machine.cores);
  return std::move(fitting).all();
}

}  // namespace heliograph::server
