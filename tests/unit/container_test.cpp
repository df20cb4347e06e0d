// Limits of a container, as the kernel tells them, and what is lowered to fit.
#include "server/config/container.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
namespace fs = std::filesystem;

namespace {

constexpr u64 kNone = std::numeric_limits<u64>::max();

/// A tree of cgroups that ends with the test.
struct Tree {
  const fs::path root = fs::temp_directory_path() / ("hg-cgroup-" + std::to_string(::getpid()));
  Tree() { fs::create_directories(root); }
  ~Tree() { fs::remove_all(root); }
  void write(const std::string& file, const std::string& text) const {
    fs::create_directories((root / file).parent_path());
    std::ofstream(root / file) << text << '\n';
  }
};

}  // namespace

TEST_CASE("container: the least of all groups upwards, version 2") {
  const Tree tree;
  tree.write("pods/one/memory.max", "max");
  tree.write("pods/memory.max", "1073741824");
  CHECK(cgroup_memory("0::/pods/one\n", tree.root) == 1u << 30);
  tree.write("pods/one/memory.max", "536870912");
  CHECK(cgroup_memory("0::/pods/one\n", tree.root) == 512u << 20);
  CHECK(cgroup_memory("0::/elsewhere\n", tree.root) == kNone);
}

TEST_CASE("container: version 1, and a container that sees only its own root") {
  const Tree tree;
  tree.write("memory/memory.limit_in_bytes", "2147483648");
  CHECK(cgroup_memory("5:cpu,memory:/docker/abc\n4:pids:/x\n0::/\n", tree.root) == 2u << 30);
  tree.write("memory/docker/abc/memory.limit_in_bytes", "1073741824");
  CHECK(cgroup_memory("5:cpu,memory:/docker/abc\n4:pids:/x\n", tree.root) == 1u << 30);
  CHECK(cgroup_memory("", tree.root) == kNone);
}

TEST_CASE("container: a quota of processors, of both versions, is rounded up") {
  const Tree tree;
  CHECK(cgroup_cores("0::/pods/one\n", tree.root) == kNone);
  tree.write("pods/one/cpu.max", "max 100000");
  CHECK(cgroup_cores("0::/pods/one\n", tree.root) == kNone);
  tree.write("pods/cpu.max", "350000 100000");
  CHECK(cgroup_cores("0::/pods/one\n", tree.root) == 4);
  tree.write("pods/one/cpu.max", "50000 100000");
  CHECK(cgroup_cores("0::/pods/one\n", tree.root) == 1);
  tree.write("cpu/docker/abc/cpu.cfs_quota_us", "-1");
  tree.write("cpu/docker/abc/cpu.cfs_period_us", "100000");
  CHECK(cgroup_cores("4:cpu,cpuacct:/docker/abc\n", tree.root) == kNone);
  tree.write("cpu/docker/abc/cpu.cfs_quota_us", "600000");
  CHECK(cgroup_cores("4:cpu,cpuacct:/docker/abc\n", tree.root) == 6);
}

TEST_CASE("container: threads are as many as cores, of many all but one, or what was set") {
  const auto threads = [](u64 cores, u32 set) {
    Config config;
    config.threads = set;
    (void)fit(config, {.memory = 1ull << 40, .descriptors = 1 << 20, .cores = cores});
    return config.threads;
  };
  CHECK(threads(1, 0) == 1);
  CHECK(threads(7, 0) == 7);
  CHECK(threads(8, 0) == 7);
  CHECK(threads(64, 0) == 63);
  CHECK(threads(64, 3) == 3);
}

TEST_CASE("container: limits are lowered to their part of what there is") {
  Config config;
  const auto fitted = fit(config, {.memory = 8ull << 30, .descriptors = 8192});
  const Limits& limits = config.limits;
  CHECK(limits.memory_bytes == 8ull << 30);
  CHECK(limits.tenant_bytes == 3ull << 30);
  CHECK(limits.blob_store_bytes == 3ull << 30);
  CHECK(limits.decodes == 2);
  CHECK(limits.decodes_per_tenant == 1);
  CHECK(limits.blob_store_bytes + limits.derived_bytes + limits.quota_bytes +
            limits.tcp_quota_bytes + limits.frame_bytes + limits.shared_bytes <
        limits.memory_bytes);
  CHECK(limits.descriptors == 8192 - 64 - 3 * 256);
  CHECK(limits.connections == Limits{}.connections);
  CHECK(std::ranges::none_of(fitted, &Fitted::is_kept));
}

TEST_CASE("container: what the operator set stays, and is named when it is more than its part") {
  Config config;
  config.limits.tenant_bytes = 1ull << 30;
  config.limits.memory_bytes = 2ull << 30;
  config.limits_set = {"tenant_bytes", "memory_bytes"};
  const auto fitted = fit(config, {.memory = 1u << 30, .descriptors = 8192});
  CHECK(config.limits.tenant_bytes == 1ull << 30);
  CHECK(config.limits.memory_bytes == 2ull << 30);
  CHECK(config.limits.blob_store_bytes == (2ull << 30) / 32 * 12);
  const auto tenant = std::ranges::find(fitted, "tenant_bytes", &Fitted::name);
  REQUIRE(tenant != fitted.end());
  CHECK(tenant->is_kept);
  CHECK(tenant->to == (2ull << 30) / 32 * 12);
}

TEST_CASE("container: what fits is left alone; few descriptors leave few connections") {
  Config config;
  const auto fitted = fit(config, {.memory = 1ull << 40, .descriptors = 1 << 20});
  REQUIRE(fitted.size() == 1);
  CHECK(fitted[0].name == "memory_bytes");
  CHECK(fit(config, {.memory = 1ull << 40, .descriptors = 256}).size() == 2);
  CHECK(config.limits.connections * 3 + config.limits.descriptors + 64 <= 256);
}
