// The journal's room: what it leaves on the disk, who may fill it, what recovery holds at a time;
// and state directories of other formats.
#include <sqlite3.h>

#include "server/journal/journal.h"
#include "server/journal/write_queue.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u64 kMega = 1 << 20;

/// One entity's attribute of this many bytes.
v1::ApplyRequest described(u64 scene, u64 number, u64 bytes) {
  v1::ApplyRequest request = placed(scene, number, "a", float(number));
  v1::Edit& edit = *request.mutable_transaction()->mutable_edits(0);
  (*edit.mutable_entity()->mutable_attributes()->mutable_values())["text"] =
      std::string(bytes, char('a' + number % 26));
  return request;
}

u64 size_of(const Folder& folder) {
  u64 bytes = 0;
  std::error_code gone;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path()))
    if (entry.is_regular_file(gone) && entry.path().filename() != "reserve")
      bytes += entry.file_size(gone);
  return bytes;
}

Config config_of(const Folder& folder, u64 tenant_disk_bytes) {
  Config config = state_config(folder.path(), 100'000);
  config.limits.snapshot_bytes = 4 * kMega;
  config.limits.watch_bytes = kMega;
  config.limits.tenant_disk_bytes = tenant_disk_bytes;
  return config;
}

/// Waits until it holds; false: it did not in 10 s.
bool becomes(const std::function<bool()>& holds) {
  for (int k = 0; k < 1000 && !holds(); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  return holds();
}

/// Runs SQL on a state directory's database; the first number that comes back.
i64 ask(const Folder& folder, const std::string& sql) {
  sqlite3* database = nullptr;
  REQUIRE(sqlite3_open((folder / "journal.db").c_str(), &database) == SQLITE_OK);
  i64 number = 0;
  const auto keep = [](void* out, int, char** texts, char**) {
    *static_cast<i64*>(out) = std::atoll(texts[0]);
    return 0;
  };
  REQUIRE(sqlite3_exec(database, sql.c_str(), keep, &number, nullptr) == SQLITE_OK);
  sqlite3_close(database);
  return number;
}

std::string refusal(const Folder& folder) {
  const Server server(folder.path());
  return server.opened ? "" : server.opened.error().where + ": " + server.opened.error().message;
}

/// A copy of a state directory that a daemon of the first format left behind when it was killed.
void copy_first_format(const Folder& folder) {
  folder.copy(std::string(HELIOGRAPH_SOURCE_DIR) + "/tests/assets/journal/format1");
  std::filesystem::permissions(folder.path(), std::filesystem::perms::owner_all);
}

}  // namespace

TEST_CASE("journal: a state directory of the first format is read, and has this one then") {
  const Folder folder;
  copy_first_format(folder);
  for (int start = 0; start < 2; ++start) {
    Server server(folder.path());
    INFO((server.opened ? "" : server.opened.error().where + server.opened.error().message));
    REQUIRE(server.opened);
    const auto session = server.daemon.sessions.open(
        {.client = "test", .tenant = server.daemon.tenants.named("local"), .resume = 0});
    const ScenePtr room = server.daemon.scenes.open("room", **session).value();
    const ScenePtr hall = server.daemon.scenes.open("hall", **session).value();
    CHECK(room->scene.head()->revision == 6 + u64(start));
    CHECK(hall->scene.head()->revision == 2);
    CHECK(hall->scene.head()->meshes.count() == 1);
    CHECK(hall->lifetime == v1::LIFETIME_DISK_SYNCED);
    CHECK(room->scene.head()->entities.count() == 2 + u64(start));
    REQUIRE(*apply(server, *session, placed(room->id, 1, fmt::format("new{}", start), 1)));
  }
  CHECK(ask(folder, "PRAGMA user_version") == 2);
}

TEST_CASE("journal: a directory of the first format that is damaged stays as it is") {
  const Folder folder;
  copy_first_format(folder);
  for (const auto& entry : std::filesystem::directory_iterator(folder / "blobs/local"))
    std::fstream(entry.path(), std::ios::in | std::ios::out).write("broken", 6);
  CHECK(refusal(folder).find("is damaged") != std::string::npos);
  CHECK(ask(folder, "PRAGMA user_version") == 0);
}

TEST_CASE("journal: another format is named, with the remedy") {
  const Folder folder;
  REQUIRE(Server(folder.path()).opened);
  (void)ask(folder, "PRAGMA user_version=7");
  CHECK(refusal(folder) ==
        "--state-dir: has format 7, this heliographd knows formats up to 2: start the version that "
        "wrote it or a newer one, or name another directory");
  (void)ask(folder, "PRAGMA user_version=2; PRAGMA application_id=42");
  CHECK(refusal(folder).find("journal.db is another program's (application_id 42") !=
        std::string::npos);
  CHECK(refusal(folder).find("name a directory of the daemon's own") != std::string::npos);
}

TEST_CASE("journal: what is superseded leaves the disk") {
  const u64 bytes = GENERATE(u64(1 << 20), u64(50'000));  // a file each, and rows of the database
  const Folder folder;
  u64 most = 0;
  const u64 edits = 100 * kMega / bytes;
  {
    Daemon daemon(config_of(folder, 1 << 30), Identities(), EventLoop::create().value());
    REQUIRE(daemon.open_journal());
    const TenantPtr tenant = daemon.tenants.named("tester");
    const auto session = daemon.sessions.open({.client = "test", .tenant = tenant, .resume = 0});
    const auto scene = daemon.scenes.create({.name = "room",
                                             .lifetime = v1::LIFETIME_DISK,
                                             .first = std::make_shared<const Snapshot>()},
                                            **session);
    REQUIRE(scene);
    for (u64 number = 1; number <= edits; ++number) {
      std::promise<EditLog::Reply> promise;
      const v1::ApplyRequest request = described((*scene)->id, number, bytes);
      apply_numbered(daemon, *session, request,
                     [&](const EditLog::Reply& reply) { promise.set_value(reply); });
      const EditLog::Reply reply = promise.get_future().get();
      INFO((*reply ? "" : reply->error().message));
      REQUIRE(*reply);
      if (number % 10 == 0) most = std::max(most, size_of(folder));
    }
    CHECK(tenant->ledger.disk->used() < 40 * kMega);
    daemon.journal->stop();
  }
  fmt::print("{} edits of {} bytes: {} bytes at most, {} after the end\n", edits, bytes, most,
             size_of(folder));
  CHECK(most < 60 * kMega);
  CHECK(size_of(folder) < 3 * (bytes + kMega));  // with what is kept for Watch
}

TEST_CASE("journal: a tenant's quota of disk binds it alone, and comes back with what it deletes") {
  const Folder folder;
  Daemon daemon(config_of(folder, 6 * kMega), Identities(), EventLoop::create().value());
  REQUIRE(daemon.open_journal());
  std::map<std::string, std::pair<std::shared_ptr<Session>, ScenePtr>> of;
  for (const std::string name : {"large", "small"}) {
    auto& [session, scene] = of[name];
    session =
        daemon.sessions.open({.client = "test", .tenant = daemon.tenants.named(name), .resume = 0})
            .value();
    scene = daemon.scenes
                .create({.name = name,
                         .lifetime = v1::LIFETIME_DISK,
                         .first = std::make_shared<const Snapshot>()},
                        *session)
                .value();
  }
  const auto send = [&](const std::string& tenant, v1::ApplyRequest request) {
    std::promise<EditLog::Reply> promise;
    request.set_scene(of[tenant].second->id);
    apply_numbered(daemon, of[tenant].first, request,
                   [&](const EditLog::Reply& reply) { promise.set_value(reply); });
    return promise.get_future().get();
  };
  u64 number = 1;
  EditLog::Reply reply;
  do {  // each another entity's: nothing is superseded
    v1::ApplyRequest request = described(0, number, kMega);
    request.mutable_transaction()->mutable_edits(0)->mutable_target()->set_name(
        fmt::format("e{}", number));
    reply = send("large", request);
  } while (*reply && ++number < 20);
  REQUIRE(!*reply);
  const Error& error = reply->error();
  CHECK(error.code == Code::kResourceExhausted);
  CHECK(error.message.find("tenant_disk_bytes") != std::string::npos);
  CHECK(error.retry_seconds > 0);
  CHECK(daemon.journal->status());
  for (u64 k = 1; k <= 50; ++k) REQUIRE(*send("small", placed(0, k, "a", float(k))));
  const auto& [session, scene] = of["large"];
  REQUIRE(daemon.scenes.remove(scene->id, *session));
  const TenantPtr large = daemon.tenants.named("large");
  daemon.journal->want_room();
  CHECK(becomes([&] { return large->ledger.disk->used() < kMega; }));
  CHECK(becomes([&] { return size_of(folder) < 3 * kMega; }));
}

TEST_CASE("journal: who has had fewer bytes is written first") {
  WriteQueue<std::string> queue;
  for (int k = 0; k < 3; ++k) queue.push("large", 8000, "L");
  for (int k = 0; k < 5; ++k) queue.push("small", 10, "s");
  CHECK(queue.take(1000) == std::vector<std::string>{"L"});  // both had none
  CHECK(queue.take(1000) == std::vector<std::string>(5, "s"));
  CHECK(queue.take(1000) == std::vector<std::string>{"L"});
  queue.push("small", 10, "s");  // comes back: not before its turn, but next
  CHECK(queue.take(1000) == std::vector<std::string>{"s"});
  CHECK(queue.size() == 1);
  CHECK(queue.take(1000) == std::vector<std::string>{"L"});
  CHECK(queue.take(1000).empty());
}

TEST_CASE("journal: a tenant's edits that wait for the disk are limited, and may be sent again") {
  const Folder folder;
  Config config = state_config(folder.path(), 100'000);
  config.limits.journal_queue = 1;
  Server server(config);
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK_SYNCED);
  constexpr u64 kEdits = 500;
  std::vector<std::promise<EditLog::Reply>> replies(kEdits);
  for (u64 k = 0; k < kEdits; ++k)
    apply_numbered(server.daemon, session, placed(scene->id, k + 1, "a", float(k)),
                   [&replies, k](const EditLog::Reply& reply) { replies[k].set_value(reply); });
  u64 done = 0;
  EditLog::Reply reply;
  for (auto& promise : replies) {
    reply = promise.get_future().get();
    if (!*reply) break;
    ++done;
  }
  REQUIRE(done < kEdits);
  CHECK(reply->error().limit == "journal_queue");
  CHECK(reply->error().retry_seconds > 0);
  for (u64 k = done + 1; k < kEdits; ++k) replies[k].get_future().wait();
  CHECK((*apply(server, session, placed(scene->id, done + 1, "a", 1)))->revision() == done + 1);
}
