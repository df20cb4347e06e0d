// States of the daemon and of its process. See metric_values.h.
#include "server/app/metric_values.h"

#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "server/config/version.h"

namespace heliograph::server {
namespace {

double resident_bytes() {
  std::ifstream file("/proc/self/statm");
  u64 pages = 0, resident = 0;
  file >> pages >> resident;
  return double(resident) * double(::sysconf(_SC_PAGESIZE));
}

double open_descriptors() {
  std::error_code error;
  const std::filesystem::directory_iterator files("/proc/self/fd", error);
  return double(std::distance(begin(files), end(files)));
}

double cpu_seconds() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return double(time.tv_sec) + 1e-6 * double(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

void add_engine(const Engine& engine, std::vector<MetricValue>& all) {
  const Load load = engine.load();
  all.push_back({"heliograph_jobs", "Render jobs and queries that wait or run", double(load.jobs)});
  all.push_back({"heliograph_derived_bytes", "Bytes of derived data on the device",
                 double(engine.derived_bytes())});
  all.push_back({"heliograph_scenes_made_again_total",
                 "Scenes that were made again, as there had been no room to keep them",
                 double(engine.scenes_made_again()),
                 {},
                 true});
  all.push_back({"heliograph_uploaded_bytes_total",
                 "Bytes copied to the device's own memory",
                 double(engine.uploaded_bytes()),
                 {},
                 true});
  const MemoryUse memory = engine.memory();
  all.push_back(
      {"heliograph_device_memory_bytes", "Bytes of GPUs' memory in use", double(memory.used)});
  all.push_back({"heliograph_device_memory_budget_bytes", "Bytes of GPUs' memory that may be",
                 double(memory.budget)});
  all.push_back({"heliograph_device_still_seconds", "How long the present slice has taken",
                 load.still_seconds});
  all.push_back({"heliograph_device_losses_total",
                 "How often the device was lost",
                 double(load.losses),
                 {},
                 true});
}

void add_tenant(const Tenant& tenant, std::vector<MetricValue>& all) {
  for (const auto& [limit, used] : tenant.used())
    all.push_back({"heliograph_tenant_used",
                   "What a tenant uses of a limit",
                   double(used),
                   {{"tenant", tenant.name}, {"limit", limit}}});
  for (const auto& [limit, value] : tenant.limits())
    all.push_back({"heliograph_tenant_limit",
                   "What a tenant may use",
                   double(value),
                   {{"tenant", tenant.name}, {"limit", limit}}});
  all.push_back({"heliograph_tenant_weight",
                 "A tenant's share of the device against other tenants'",
                 tenant.weight(),
                 {{"tenant", tenant.name}}});
}

void add_process(std::vector<MetricValue>& all) {
  all.push_back({"process_resident_memory_bytes", "Resident memory", resident_bytes()});
  all.push_back({"process_open_fds", "Open descriptors", open_descriptors()});
  all.push_back(
      {"process_cpu_seconds_total", "Processor time, user and system", cpu_seconds(), {}, true});
}

}  // namespace

std::vector<MetricValue> metric_values(const Daemon& daemon, u32 connections) {
  std::vector<MetricValue> all;
  all.push_back({"heliograph_info",
                 "1; the labels say what runs",
                 1,
                 {{"version", kVersion}, {"backend", daemon.config.backend}}});
  all.push_back({"heliograph_ready", "1 when the health service says that it is ready",
                 daemon.health.is_ready() ? 1.0 : 0.0});
  if (daemon.journal)
    all.push_back({"heliograph_durable_writing", "0 while durable scenes are read-only",
                   daemon.journal->status() ? 1.0 : 0.0});
  all.push_back({"heliograph_log_dropped_lines_total",
                 "Log lines that were dropped because nobody read them",
                 double(daemon.log.dropped()),
                 {},
                 true});
  for (const auto& [part, seconds] : daemon.watchdog.still_seconds())
    all.push_back({"heliograph_still_seconds",
                   "How long a part of the daemon owes an answer",
                   seconds,
                   {{"part", part}}});
  all.push_back({"heliograph_connections", "Open connections", double(connections)});
  all.push_back({"heliograph_sessions", "Open sessions", double(daemon.sessions.count())});
  all.push_back({"heliograph_scenes", "Scenes", double(daemon.scenes.all().size())});
  all.push_back({"heliograph_blob_bytes", "Bytes of all blobs, uploads and assets",
                 double(daemon.tenants.ledger().bytes->used())});
  if (const Engine* engine = daemon.engine->get()) add_engine(*engine, all);
  for (const TenantPtr& tenant : daemon.tenants.all()) add_tenant(*tenant, all);
  add_process(all);
  return all;
}

}  // namespace heliograph::server
