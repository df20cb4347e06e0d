// restore(): the scene that comes back goes on as the one that was described, ids included.
#include "renderer/scene/restore.h"

#include <random>

#include "tests/unit/dump.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

namespace {

std::shared_ptr<const Snapshot> restored(const Snapshot& snapshot) {
  auto made = restore(describe(snapshot), numbers(snapshot), {});
  INFO((made ? "" : made.error().where + ": " + made.error().message));
  REQUIRE(made);
  return *made;
}

std::string ids_of(const TableIds& ids) {
  const auto number = [](u32 n) { return fmt::format("{}", n); };
  return dump::list(ids.versions, number) + dump::list(ids.order, number);
}
/// Everything a scene holds, its ids, and what it gives out next.
std::string all_of(const Snapshot& snapshot) {
  const SceneNumbers n = numbers(snapshot);
  std::string out =
      dump::text(snapshot) + fmt::format("{} {} {}\n", n.revision, n.next_label, n.advances);
  for (const TableIds* ids : {&n.entities, &n.meshes, &n.materials, &n.textures, &n.volumes})
    out += ids_of(*ids) + "\n";
  snapshot.names.for_each(
      [&](const std::string& name, Id id) { out += fmt::format("{}={:x} ", name, id.value); });
  return out + dump::list(n.without_label, [](u32 i) { return fmt::format("{}", i); });
}

/// One random edit among a few names, so that indices are freed and used again.
Edit random_edit(std::mt19937& random) {
  const auto pick = [&](u32 n) { return u32(random() % n); };
  const std::string e = fmt::format("e{}", pick(12)), m = fmt::format("m{}", pick(3));
  switch (pick(9)) {
    case 0:
      return named(e, Remove{true});
    case 1:
      return named(m, Remove{true});
    case 2:
      return named(m, triangle());
    case 3:
      return named(e, showing(m));
    case 4:
      return named(e, beneath(fmt::format("e{}", pick(12))));
    case 5:
      return named(e, labelled(pick(3) ? 100 + pick(20) : 0));
    case 6:
      return named(fmt::format("t{}", pick(3)), textured(Id{}));
    case 7:
      return anonymous(Advance{0.5});
    default:
      return named(e, placed(float(pick(100))));
  }
}

}  // namespace

TEST_CASE("restore: after every transaction the copy is the same and goes on the same") {
  std::mt19937 random(7);
  auto live = std::make_shared<const Snapshot>();
  auto copy = live;
  u32 applied = 0;
  for (int round = 0; round < 4000; ++round) {
    Transaction transaction;
    for (u32 k = 1 + u32(random() % 3); k > 0; --k)
      transaction.edits.push_back(random_edit(random));
    const auto mine = apply(*live, transaction, {}), theirs = apply(*copy, transaction, {});
    REQUIRE(mine.has_value() == theirs.has_value());
    if (!mine) continue;
    ++applied;
    REQUIRE(mine->ids == theirs->ids);
    live = mine->snapshot;
    copy = theirs->snapshot;
    if (round % 5 == 0) copy = restored(*copy);
    REQUIRE(all_of(*copy) == all_of(*live));
  }
  CHECK(applied > 1000);
}

TEST_CASE("restore: numbers that are no scene's are refused") {
  Stage scene;
  scene({named("a", PutEntity{}), named("b", PutEntity{})});
  SceneNumbers wrong = numbers(*scene.now);
  wrong.entities.order.front() = 9;
  CHECK(restore(describe(*scene.now), wrong, {}).error().where == "numbers");
  wrong = numbers(*scene.now);
  wrong.entities.order[1] = wrong.entities.order[0];
  CHECK(restore(describe(*scene.now), wrong, {}).error().where == "numbers");
  wrong = numbers(*scene.now);
  wrong.without_label = {7};
  CHECK(restore(describe(*scene.now), wrong, {}).error().where == "numbers");
}
