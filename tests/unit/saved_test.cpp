// Scenes that are not durable, saved for the next daemon: they go on there, once, and leave
// nothing.
#include "server/convert/fields.h"
#include "server/journal/journal.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

/// A scene with `edits` entities, by its session.
ScenePtr furnished(Server& server, const std::shared_ptr<Session>& session, bool is_shared,
                   u64 edits) {
  const ScenePtr scene =
      server.daemon.scenes
          .create({.name = is_shared ? "room" : "",
                   .lifetime = is_shared ? v1::LIFETIME_DAEMON : v1::LIFETIME_SESSION,
                   .first = std::make_shared<const Snapshot>(),
                   .request_id = "made",
                   .method = "CreateScene"},
                  *session)
          .value();
  for (u64 number = 1; number <= edits; ++number)
    REQUIRE(*apply(server, session, placed(scene->id, number, fmt::format("e{}", number), 1)));
  return scene;
}

u32 files_in(const std::string& folder) {
  u32 count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    count += entry.is_regular_file() ? 1 : 0;
  return count;
}

}  // namespace

TEST_CASE("saved: the next daemon has the scenes, their numbers and their replies") {
  const bool is_shared = GENERATE(false, true);
  const Folder folder;
  u64 id = 0, owner = 0;
  std::string before;
  {
    Server server(folder.path());
    const auto session = server.session();
    owner = session->id();
    const ScenePtr scene = furnished(server, session, is_shared, 30);
    id = scene->id;
    const auto watched = scene->watched();
    server.daemon.save_scenes();
    const auto late = apply(server, session, placed(id, 31, "late", 1));
    REQUIRE(!*late);
    CHECK(late->error().code == Code::kUnavailable);
    CHECK(late->error().retry_seconds > 0);
    CHECK(!server.daemon.scenes.create({.first = std::make_shared<const Snapshot>()}, *session));
    CHECK(!server.daemon.scenes.remove(id, *session));
    before = fingerprint(*scene->scene.head());
    server.daemon.journal->stop();
  }
  Server next(folder.path());
  INFO((next.opened ? "" : next.opened.error().where + ": " + next.opened.error().message));
  REQUIRE(next.opened);
  CHECK(files_in(folder / "blobs") == 0);
  const auto session = next.session(owner);
  const ScenePtr scene = next.daemon.scenes.find(id, *session).value();
  CHECK(scene->owner == (is_shared ? 0 : owner));
  CHECK(scene->journal == nullptr);
  CHECK(scene->made_by.session == owner);
  CHECK(scene->made_by.request_id == "made");
  CHECK(fingerprint(*scene->scene.head()) == before);
  CHECK((*apply(next, session, placed(id, 30, "again", 1)))->revision() == 30);
  CHECK(fingerprint(*scene->scene.head()) == before);
  CHECK((*apply(next, session, placed(id, 31, "late", 1)))->revision() == 31);
  next.daemon.sessions.close(owner);
  CHECK(bool(next.daemon.scenes.find(id, *next.session())) == is_shared);
}

TEST_CASE("saved: a daemon that is killed has nothing to hand on; one that saves again has") {
  const bool saves_again = GENERATE(false, true);
  const Folder folder, crashed;
  u64 id = 0;
  {
    Server server(folder.path());
    const auto session = server.session();
    id = furnished(server, session, true, 3)->id;
    server.daemon.save_scenes();
    server.daemon.journal->stop();
  }
  Server second(folder.path());
  if (saves_again) second.daemon.save_scenes();
  crashed.copy(folder.path());
  Server third(crashed.path());
  REQUIRE(third.opened);
  CHECK(bool(third.daemon.scenes.find(id, *third.session())) == saves_again);
  CHECK(files_in(crashed / "blobs") == 0);
}

TEST_CASE("saved: as much as may be, the small ones first; durable scenes are as they were") {
  const Folder folder;
  u64 small = 0, large = 0, durable = 0;
  {
    Server server(folder.path());
    const auto session = server.session();
    durable = server.create(*session, "kept", v1::LIFETIME_DISK)->id;
    REQUIRE(*apply(server, session, placed(durable, 1, "a", 1)));
    large = furnished(server, session, false, 1)->id;
    v1::ApplyRequest request;
    request.set_scene(large);
    request.set_number(2);
    v1::Edit* edit = request.mutable_transaction()->add_edits();
    edit->mutable_target()->set_name("mesh");
    *edit->mutable_mesh() = triangle();
    *edit->mutable_mesh()->mutable_positions() = f32({3000, 3}, std::vector<float>(3 * 3000, 1.0F));
    REQUIRE(*apply(server, session, request));
    small = furnished(server, session, false, 1)->id;
    const auto saved = server.daemon.journal->save(server.daemon.scenes.capture_last(), 30'000);
    CHECK(saved.scenes == 1);
    CHECK(saved.lost == 1);
    CHECK(saved.bytes < 30'000);
    CHECK(saved.because.error().message.find("saved_bytes") != std::string::npos);
    server.daemon.journal->stop();
  }
  Server next(folder.path());
  REQUIRE(next.opened);
  const auto session = next.session();
  CHECK(next.daemon.scenes.find(small, *session));
  CHECK(!next.daemon.scenes.find(large, *session));
  CHECK(next.daemon.scenes.find(durable, *session).value()->scene.head()->revision == 1);
}

TEST_CASE("saved: a crash while it saves, and a file that is damaged, leave the durable scenes") {
  const Folder folder, crashed;
  Server server(folder.path());
  const auto session = server.session();
  const u64 durable = server.create(*session, "kept", v1::LIFETIME_DISK)->id;
  REQUIRE(*apply(server, session, placed(durable, 1, "a", 1)));
  const u64 plain = furnished(server, session, true, 3)->id;
  auto states = server.daemon.scenes.capture_last();
  REQUIRE(states.size() == 1);
  REQUIRE(store_state(states[0], server.daemon.journal->files("tester"), Room::kSnapshot));
  const std::string file = "blobs/tester/" + hex(states[0].row.state());
  crashed.copy(folder.path());  // a file, and no row of it yet
  {
    Server next(crashed.path());
    REQUIRE(next.opened);
    CHECK(next.daemon.scenes.find(durable, *next.session()));
    CHECK(!next.daemon.scenes.find(plain, *next.session()));
    CHECK(!std::filesystem::exists(crashed / file));
  }
  const auto saved = server.daemon.journal->save(std::move(states), 1 << 30);
  REQUIRE(saved.scenes == 1);
  crashed.copy(folder.path());
  std::fstream(crashed / file, std::ios::in | std::ios::out).write("broken", 6);
  Server next(crashed.path());
  REQUIRE(next.opened);
  CHECK(next.daemon.scenes.find(durable, *next.session()));
  CHECK(!next.daemon.scenes.find(plain, *next.session()));
}

TEST_CASE("saved: what nobody comes back for is freed after the grace time") {
  const Folder folder;
  u64 gone = 0, kept = 0, owner = 0;
  {
    Server server(folder.path());
    const auto session = server.session(), other = server.session();
    gone = furnished(server, session, false, 2)->id;
    kept = furnished(server, other, false, 2)->id;
    owner = other->id();
    server.daemon.save_scenes();
    server.daemon.journal->stop();
  }
  Config config = state_config(folder.path(), 100'000);
  config.grace_seconds = 0;  // five seconds for the first carrier
  Daemon daemon(std::move(config), Identities(), EventLoop::create().value());
  REQUIRE(daemon.open_journal());
  const TenantPtr tenant = daemon.tenants.named("tester");
  const auto session =
      daemon.sessions.open({.client = "test", .tenant = tenant, .resume = owner}).value();
  daemon.sessions.attach(owner);
  daemon.loop->after(std::chrono::milliseconds(4500),
                     [&] { CHECK(daemon.scenes.find(gone, *session)); });
  daemon.loop->after(std::chrono::milliseconds(5500), [&] { daemon.loop->quit(); });
  daemon.loop->run();
  CHECK(!daemon.scenes.find(gone, *session));
  CHECK(daemon.scenes.find(kept, *session));
}
