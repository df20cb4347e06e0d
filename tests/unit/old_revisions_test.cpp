// Old revisions of a large scene: freed by the work pool, and never many at a time.
#include <latch>

#include "server/calls/daemon.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u32 kPoolThreads = 64;  // more than it has
constexpr u32 kMany = 5000;       // entities, so that freeing takes a while

std::shared_ptr<const Snapshot> with_entities(u32 count) {
  Snapshot scene;
  for (u32 i = 0; i < count; ++i) {
    (void)scene.entities.insert({});
    scene.poses.push_back(mat4x3(1));
  }
  return std::make_shared<const Snapshot>(std::move(scene));
}

/// What became of the heads that a scene had.
struct Heads {
  std::vector<std::weak_ptr<const Snapshot>> all;
  [[nodiscard]] u64 alive() const {
    return u64(std::ranges::count_if(all, [](const auto& head) { return !head.expired(); }));
  }
};

}  // namespace

TEST_CASE("old revisions: they do not pile up while the work pool is busy") {
  const u32 count = GENERATE(1u, kMany);
  const Folder folder;
  Server server(folder.path());
  const auto session = server.session();
  const auto scene = server.daemon.scenes.create({.first = with_entities(count)}, *session).value();
  const u64 kept = server.daemon.config.limits.revisions;
  std::latch free(1);
  for (u32 i = 0; i < kPoolThreads; ++i)
    REQUIRE(server.daemon.pool.post(WorkPool::kDaemon, [&free] { free.wait(); }));
  Heads heads;
  for (u64 number = 1; number <= kept + 30; ++number) {
    heads.all.push_back(scene->scene.head());
    REQUIRE(*apply(server, session, placed(scene->id, number, "e", float(number))));
  }
  const u64 waiting = count == kMany ? 1 : 0;
  CHECK(heads.alive() == kept - 1 + waiting);  // the head itself is not among them
  free.count_down();
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (heads.alive() >= kept && std::chrono::steady_clock::now() < until)
    std::this_thread::yield();
  CHECK(heads.alive() == kept - 1);
}
