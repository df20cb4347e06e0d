// Events of a scene: each revision's, without gaps, within limits, also across a restart.
#include "server/store/scene_events.h"

#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

std::shared_ptr<Budget> room(u64 bytes) {
  return std::make_shared<Budget>(bytes,
                                  Budget::RefusalText{"bytes", "remove some", "tenant_bytes"});
}

SceneEvents::Event text(u64 bytes, char fill = 'x') {
  return std::make_shared<const std::string>(bytes, fill);
}

/// The oldest revision that is told.
Revision oldest(const SceneEvents& events) {
  const auto found = events.at(1);
  return found ? 1 : found.error().expected;
}

v1::WatchReply parsed(const SceneEvents& events, Revision revision) {
  v1::WatchReply reply;
  const auto event = events.at(revision);
  REQUIRE(event);
  REQUIRE(*event);
  REQUIRE(reply.ParseFromString(**event));
  return reply;
}

}  // namespace

TEST_CASE("events: nothing is kept before keep(), everything after it") {
  SceneEvents events({}, room(1000), 5);
  events.add(6, nullptr);
  CHECK(!events.is_kept());
  CHECK(oldest(events) == 7);
  events.keep();
  events.add(7, text(1, 'a'));
  events.add(8, text(1, 'b'));
  CHECK(**events.at(7) == "a");
  CHECK(**events.at(8) == "b");
  CHECK(*events.at(9) == nullptr);
  const auto later = events.at(10);
  REQUIRE(!later);
  CHECK(later.error().code == Code::kOutOfRange);
  CHECK(later.error().expected == 9);
  const auto earlier = events.at(6);
  REQUIRE(!earlier);
  CHECK(earlier.error().code == Code::kOutOfRange);
  CHECK(earlier.error().expected == 7);
  CHECK(earlier.error().message.find("compacted") != std::string::npos);
  CHECK(events.list(8).size() == 2);
  CHECK(events.list(7).size() == 1);
  CHECK(events.list(3).empty());
}

TEST_CASE("events: the oldest go by number, by bytes and by the owner's bytes") {
  const auto budget = room(1 << 20);
  {
    SceneEvents events({.events = 3, .bytes = 1 << 20}, budget, 0);
    events.keep();
    for (Revision r = 1; r <= 10; ++r) events.add(r, text(10));
    CHECK(oldest(events) == 8);
    CHECK(budget->used() >= 30);
  }
  CHECK(budget->used() == 0);
  SceneEvents few({.events = 1000, .bytes = 1000}, budget, 0);
  few.keep();
  for (Revision r = 1; r <= 100; ++r) few.add(r, text(100));
  CHECK(oldest(few) > 90);
  CHECK(budget->used() <= 1000);
  few.add(101, text(5000));  // the newest is kept however large it is
  CHECK(oldest(few) == 101);
  SceneEvents poor({}, room(500), 0);
  poor.keep();
  poor.add(1, text(100));
  poor.add(2, text(100));
  poor.add(3, text(100));
  CHECK(oldest(poor) == 2);
  poor.add(4, text(1000));  // more than the owner may have
  CHECK(oldest(poor) == 5);
  poor.add(5, text(100));
  CHECK(oldest(poor) == 5);
  CHECK(poor.head() == 5);
}

TEST_CASE("events: a commit's event is what was sent, with its ids, for one revision each") {
  const Folder folder;
  Server server(folder.path());
  const auto session = server.session();
  const ScenePtr shared = server.create(*session, "room", v1::LIFETIME_DAEMON);
  for (u64 number = 1; number <= 40; ++number)
    REQUIRE(*apply(server, session, placed(shared->id, number, "a", float(number))));
  for (Revision r = 1; r <= 40; ++r) {
    const auto reply = parsed(*shared->events, r);
    CHECK(reply.revision() == r);
    CHECK(serialize(reply.transaction()) ==
          serialize(placed(shared->id, r, "a", float(r)).transaction()));
    CHECK(reply.ids().size() == 8);
    CHECK(reply.counts_size() == 1);
  }
  const auto refused = apply(server, session, placed(shared->id, 41, "a", NAN));
  CHECK(!*refused);
  CHECK(shared->events->head() == 40);
  CHECK(*shared->events->at(41) == nullptr);
}

TEST_CASE("events: a private scene has those since it is watched") {
  const Folder folder;
  Server server(folder.path());
  const auto session = server.session();
  const ScenePtr scene =
      server.daemon.scenes
          .create({.name = "", .first = std::make_shared<const Snapshot>()}, *session)
          .value();
  REQUIRE(*apply(server, session, placed(scene->id, 1, "a", 1)));
  CHECK(scene->events->list(1).empty());
  const auto events = scene->watched();
  REQUIRE(*apply(server, session, placed(scene->id, 2, "a", 2)));
  CHECK(!events->at(1));
  CHECK(parsed(*events, 2).revision() == 2);
}

TEST_CASE("events: after a crash or a drain they are the same") {
  const bool has_snapshots = GENERATE(false, true);
  const Folder folder, crashed;
  Server server(folder.path(), has_snapshots ? 30 : 100'000);
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
  for (u64 number = 1; number <= 100; ++number)
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
  const auto check = [&](const std::string& place) {
    Server next(place);
    REQUIRE(next.opened);
    const ScenePtr found = next.daemon.scenes.open("room", *next.session()).value();
    CHECK(found->events->head() == 100);
    for (Revision r = 1; r <= 100; ++r) CHECK(**found->events->at(r) == **scene->events->at(r));
    REQUIRE(*apply(next, next.session(), placed(found->id, 1, "b", 1)));
    CHECK(parsed(*found->events, 101).revision() == 101);
  };
  if (has_snapshots) std::this_thread::sleep_for(std::chrono::milliseconds(300));
  crashed.copy(folder.path());
  check(crashed.path());
  server.daemon.journal->stop();
  crashed.copy(folder.path());
  check(crashed.path());
}
