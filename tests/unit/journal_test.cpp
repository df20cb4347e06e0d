// Durable scenes: what was acknowledged is there after the daemon, once, under the same ids.
#include "server/journal/journal.h"

#include "server/convert/fields.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

v1::Edit* add(v1::ApplyRequest& request, const std::string& name) {
  v1::Edit* edit = request.mutable_transaction()->add_edits();
  edit->mutable_target()->set_name(name);
  return edit;
}

/// A random edit among a few names; about a fourth of them is refused.
v1::ApplyRequest random_edit(u64 scene, u64 number, std::mt19937& random) {
  const std::string name = fmt::format("e{}", random() % 20);
  v1::ApplyRequest request;
  request.set_scene(scene);
  request.set_number(number);
  v1::Edit* edit = add(request, name);
  switch (random() % 6) {
    case 0:
      edit->mutable_remove();
      break;
    case 1:
      edit->set_mode(v1::Edit::MODE_CREATE);
      edit->mutable_entity();
      break;
    case 2:
      edit->mutable_target()->set_name(fmt::format("m{}", random() % 4));
      *edit->mutable_mesh() = triangle();
      break;
    case 3:
      edit->mutable_entity()->mutable_mesh()->set_name(fmt::format("m{}", random() % 4));
      break;
    case 4:
      request.mutable_transaction()->clear_edits();
      request.mutable_transaction()->add_edits()->mutable_advance()->set_dt(0.25);
      break;
    default:
      request = placed(scene, number, name, float(random() % 100));
  }
  return request;
}

/// The scene's first edit: a mesh whose positions are an upload of these bytes.
v1::ApplyRequest uploaded(Session& session, u64 scene, const std::string& bytes) {
  v1::UploadBlobRequest first;
  first.set_request_id("up");
  first.set_size(bytes.size());
  auto incoming = session.arrays().begin(first).value();
  REQUIRE(incoming->append(bytes));
  REQUIRE(session.arrays().finish(first, std::move(*incoming)));
  v1::ApplyRequest request;
  request.set_scene(scene);
  request.set_number(1);
  v1::Mesh* mesh = add(request, "mesh")->mutable_mesh();
  *mesh = triangle();
  mesh->mutable_positions()->clear_source();
  mesh->mutable_positions()->set_upload("up");
  mesh->mutable_positions()->set_shape(0, bytes.size() / 12);
  return request;
}

std::string bytes_of(const Expected<v1::ApplyReply>& reply) {
  return reply ? serialize(*reply)
               : fmt::format("{} {} {}", int(reply.error().code), reply.error().where,
                             reply.error().message);
}

ScenePtr scene_of(Server& server, u64 id) {
  return server.daemon.scenes.find(id, *server.session()).value();
}

}  // namespace

TEST_CASE("journal: after a crash the scene, its ids and its replies are the same") {
  const v1::Lifetime lifetime = GENERATE(v1::LIFETIME_DISK, v1::LIFETIME_DISK_SYNCED);
  const u64 snapshot_edits = GENERATE(100'000, 40);
  const Folder folder, crashed;
  Server server(folder.path(), snapshot_edits);
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", lifetime);
  std::mt19937 random(3);
  std::vector<std::string> replies;
  u32 refused = 0;
  for (u64 number = 1; number <= 300; ++number) {
    const auto reply = apply(server, session, random_edit(scene->id, number, random));
    refused += *reply ? 0 : 1;
    replies.push_back(bytes_of(*reply));
  }
  CHECK(refused > 30);
  CHECK(refused < 200);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // a snapshot may be under way
  crashed.copy(folder.path());
  Server next(crashed.path());
  INFO((next.opened ? "" : next.opened.error().where + ": " + next.opened.error().message));
  REQUIRE(next.opened);
  const auto resumed = next.session(session->id());
  const ScenePtr found = next.daemon.scenes.open("room", *resumed).value();
  CHECK(found->id == scene->id);
  CHECK(found->lifetime == lifetime);
  CHECK(fingerprint(*found->scene.head()) == fingerprint(*scene->scene.head()));
  for (const u64 number : {1ull, 150ull, 300ull})
    CHECK(bytes_of(*apply(next, resumed, placed(scene->id, number, "other", 1))) ==
          replies[number - 1]);
  CHECK(next.daemon.scenes.next_edit(*found, resumed->id()) == 301);
  const auto mine = apply(server, session, placed(scene->id, 301, "new", 1));
  const auto theirs = apply(next, resumed, placed(scene->id, 301, "new", 1));
  CHECK(bytes_of(*mine) == bytes_of(*theirs));
  CHECK(fingerprint(*found->scene.head()) == fingerprint(*scene->scene.head()));
}

TEST_CASE("journal: a snapshot at the end, and nothing to replay after it") {
  const Folder folder;
  std::string before;
  {
    Server server(folder.path());
    const auto session = server.session();
    const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
    for (u64 number = 1; number <= 50; ++number)
      REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
    before = fingerprint(*scene->scene.head());
    server.daemon.journal->stop();
    CHECK(!*apply(server, session, placed(scene->id, 51, "a", 0)));
    CHECK(fingerprint(*scene->scene.head()) == before);
  }
  CHECK(std::filesystem::file_size(folder / "journal.db") < 40'000);
  Server next(folder.path());
  REQUIRE(next.opened);
  const ScenePtr found = next.daemon.scenes.open("room", *next.session()).value();
  CHECK(fingerprint(*found->scene.head()) == before);
}

TEST_CASE("journal: a start that has many edits to replay makes a snapshot of them at once") {
  const u64 snapshot_edits = GENERATE(40, 60);
  const Folder folder, crashed, killed;
  Server server(folder.path());
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
  for (u64 number = 1; number <= 50; ++number)
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
  crashed.copy(folder.path());
  {
    Server next(crashed.path(), snapshot_edits);
    REQUIRE(next.opened);
    killed.copy(crashed.path());
  }
  u64 replayed = 0;
  {
    Daemon& daemon = server.daemon;
    const auto disk = [&](const std::string& name) {
      return daemon.tenants.named(name)->ledger.disk;
    };
    const auto journal =
        Journal::open({.folder = killed.path(), .disk = disk}, daemon.pool, daemon.log).value();
    const auto count = [&](u64, const journal::Record&, const v1::Transaction*) {
      ++replayed;
      return Status();
    };
    REQUIRE(journal->read([](const journal::SceneRow&) { return Status(); }, count));
  }
  CHECK(replayed == (snapshot_edits < 50 ? 0 : 50));
  Server last(killed.path());
  REQUIRE(last.opened);
  const ScenePtr found = last.daemon.scenes.open("room", *last.session()).value();
  CHECK(fingerprint(*found->scene.head()) == fingerprint(*scene->scene.head()));
}

TEST_CASE("journal: arrays are files, and go when nothing needs them") {
  const Folder folder;
  Server server(folder.path(), 10);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
  const std::string upload(3 * 4 * 1000, '\0');
  REQUIRE(*apply(server, session, uploaded(*session, scene->id, upload)));
  const std::string file = folder / ("blobs/tester/" + hex(sha256(upload)));
  CHECK(std::filesystem::file_size(file) == upload.size());

  const Folder crashed;
  crashed.copy(folder.path());
  Server next(crashed.path());
  INFO((next.opened ? "" : next.opened.error().where + ": " + next.opened.error().message));
  REQUIRE(next.opened);
  CHECK(fingerprint(*scene_of(next, scene->id)->scene.head()) == fingerprint(*scene->scene.head()));

  v1::ApplyRequest removal;
  removal.set_scene(scene->id);
  removal.set_number(2);
  add(removal, "mesh")->mutable_remove();
  REQUIRE(*apply(server, session, removal));
  for (u64 number = 3; number <= 40; ++number)
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", 1)));
  server.daemon.journal->stop();
  CHECK(!std::filesystem::exists(file));
}

TEST_CASE("journal: scenes come back whatever the limits are now, which bind then") {
  const Folder folder;
  u64 scene = 0;
  {
    Server server(folder.path());
    const auto session = server.session();
    scene = server.create(*session, "room", v1::LIFETIME_DISK)->id;
    REQUIRE(*apply(server, session, uploaded(*session, scene, std::string(12'000, '\0'))));
    REQUIRE(*apply(server, session, placed(scene, 2, "a", 1)));
    REQUIRE(*apply(server, session, placed(scene, 3, "b", 1)));
  }
  Config config = state_config(folder.path(), 100'000);
  config.limits.tenant_entities = config.limits.tenant_bytes = 1;
  config.limits.blob_bytes = config.limits.blob_store_bytes = 1;
  Daemon daemon(std::move(config), Identities(), EventLoop::create().value());
  REQUIRE(daemon.open_journal());
  const TenantPtr tenant = daemon.tenants.named("tester");
  CHECK(tenant->ledger.entities->used() == 2);
  CHECK(tenant->ledger.entities->limit() == 1);
  CHECK(tenant->ledger.bytes->limit() == 1);
  CHECK(tenant->ledger.bytes->used() > 12'000);
}

TEST_CASE("journal: a damaged file, a second daemon, a scene that was deleted") {
  const Folder folder;
  std::string state;
  {
    Server server(folder.path());
    const auto session = server.session();
    const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
    CHECK(Server(folder.path()).opened.error().code == Code::kAlreadyExists);
    ScenePtr gone = server.create(*session, "gone", v1::LIFETIME_DISK_SYNCED);
    REQUIRE(*apply(server, session, placed(gone->id, 1, "a", 1)));
    REQUIRE(server.daemon.scenes.remove(gone->id, *session));
    gone.reset();
    for (int k = 0; k < 200 && server.tenant->ledger.entities->used() > 0; ++k)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    CHECK(server.tenant->ledger.entities->used() == 0);
    REQUIRE(*apply(server, session, placed(scene->id, 1, "a", 1)));
  }
  {
    Server server(folder.path());
    REQUIRE(server.opened);
    CHECK(server.daemon.scenes.list(*server.session()).size() == 1);
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder / "blobs/tester"))
    state = entry.path().string();
  std::fstream(state, std::ios::in | std::ios::out).write("broken", 6);
  const Server server(folder.path());
  REQUIRE(!server.opened);
  CHECK(server.opened.error().where == "--state-dir");
  CHECK(server.opened.error().message.find("is damaged") != std::string::npos);
}

TEST_CASE("journal: who watches is told of each revision, once it is there") {
  const Folder folder;
  Server server(folder.path());
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
  std::vector<Revision> told;
  const auto watch = scene->watch([&](Revision revision) {
    if (scene->scene.head()->revision == revision) told.push_back(revision);
  });
  std::vector<Revision> all;
  for (u64 number = 1; number <= 20; ++number) {
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
    all.push_back(number);
  }
  CHECK(told == all);
}

TEST_CASE("journal: nobody else reads it") {
  using std::filesystem::perms;
  const Folder folder;
  const auto refusal = [&] {
    const Server server(folder.path());
    return server.opened ? "" : server.opened.error().where + " " + server.opened.error().message;
  };
  for (const perms others : {perms::others_read, perms::group_exec, perms::others_write}) {
    std::filesystem::permissions(folder.path(), perms::owner_all | others);
    CHECK(refusal() == fmt::format("--state-dir the folder {} belongs to or is open to other "
                                   "users; choose one of yours or run `chmod 700` on it",
                                   folder.path()));
  }
  CHECK(std::filesystem::is_empty(folder.path()));
  std::filesystem::permissions(folder.path(), perms::owner_all);
  std::ofstream(folder / "journal.db").close();
  std::filesystem::permissions(folder / "journal.db", perms(0644));
  const Server server(folder.path());
  REQUIRE(server.opened);
  for (const std::string name : {"journal.db", "journal.db-wal"})
    CHECK(std::filesystem::status(folder / name).permissions() == perms(0600));
  if (::geteuid() != 0) return;
  const Folder strange;
  REQUIRE(::chown(strange.path().c_str(), 4242, 4242) == 0);
  CHECK(Server(strange.path()).opened.error().code == Code::kPermissionDenied);
}

TEST_CASE("journal: who may be durable") {
  const Folder folder;
  Server server(folder.path());
  const auto session = server.session();
  Scenes plain(server.daemon.pool, {});
  const auto refused = plain.create(
      {.name = "", .lifetime = v1::LIFETIME_DISK, .first = std::make_shared<const Snapshot>()},
      *session);
  CHECK(refused.error().code == Code::kFailedPrecondition);
  CHECK(refused.error().message.find("--state-dir") != std::string::npos);
}
