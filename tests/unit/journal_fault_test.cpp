// The journal on disks that fail, lie, fill up or lose power: nothing acknowledged is lost, nothing
// is acknowledged that is not kept.
#include "server/journal/journal.h"
#include "tests/unit/fault_vfs.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

FaultVfs& vfs() { return FaultVfs::instance(); }

/// Waits until the journal is written again; seconds.
double seconds_until_written(Server& server) {
  const auto start = std::chrono::steady_clock::now();
  while (!server.daemon.journal->status())
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// Changes whenever the state directory does.
std::string contents(const Folder& folder) {
  std::string text;
  for (const char* name : {"journal.db", "journal.db-wal"}) {
    std::ifstream file(folder / name, std::ios::binary);
    text += sha256(std::string(std::istreambuf_iterator<char>(file), {}));
  }
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder / "blobs"))
    text += entry.path().filename();
  return text;
}

/// The state directory after a loss of power.
void lose_power(const Folder& from, const Folder& to, std::mt19937& random) {
  std::filesystem::create_directories(to / "blobs");
  std::error_code gone;  // a file, in between
  std::filesystem::copy(from / "blobs", to / "blobs", std::filesystem::copy_options::recursive,
                        gone);
  for (const char* name : {"journal.db", "journal.db-wal"})
    write(to / name, vfs().after_power_loss(from / name, random));
}

}  // namespace

TEST_CASE("journal: a write or an fsync fails; edits go on when it works again") {
  vfs();
  const auto [code, error] = GENERATE(table<Code, int>({{Code::kUnavailable, SQLITE_IOERR_WRITE},
                                                        {Code::kResourceExhausted, SQLITE_FULL},
                                                        {Code::kUnavailable, SQLITE_IOERR_FSYNC}}));
  const Folder folder, crashed;
  Server server(folder.path());
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK_SYNCED);
  for (u64 number = 1; number <= 20; ++number)
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
  const std::string before = fingerprint(*scene->scene.head());
  auto& fault = error == SQLITE_IOERR_FSYNC ? vfs().sync_error : vfs().write_error;
  fault = error;
  for (int attempt = 0; attempt < 3; ++attempt) {
    const auto refused = apply(server, session, placed(scene->id, 21, "a", -1));
    REQUIRE(!*refused);
    CHECK(refused->error().code == code);
    CHECK(refused->error().retry_seconds > 0);
    CHECK(server.daemon.journal->status().error().message.find("read-only") != std::string::npos);
  }
  CHECK(fingerprint(*scene->scene.head()) == before);
  CHECK(scene->scene.pending()->revision == 20);
  CHECK(server.daemon.scenes.next_edit(*scene, session->id()) == 21);
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));  // a second failure, to open it
  CHECK(!server.daemon.journal->status());
  fault = SQLITE_OK;
  CHECK(seconds_until_written(server) < 3);
  REQUIRE((*apply(server, session, placed(scene->id, 21, "a", 21)))->revision() == 21);
  crashed.copy(folder.path());
  Server next(crashed.path());
  INFO((next.opened ? "" : next.opened.error().where + ": " + next.opened.error().message));
  REQUIRE(next.opened);
  const ScenePtr found = next.daemon.scenes.open("room", *next.session()).value();
  CHECK(fingerprint(*found->scene.head()) == fingerprint(*scene->scene.head()));
}

TEST_CASE("journal: an edit that was not committed finds its upload when it is sent again") {
  vfs();
  const Folder folder;
  Server server(folder.path());
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK_SYNCED);
  v1::UploadBlobRequest upload;
  upload.set_request_id("positions");
  upload.set_size(9 * sizeof(float));
  auto incoming = session->arrays().begin(upload);
  REQUIRE((*incoming)->append(std::string(upload.size(), '\0')));
  REQUIRE(session->arrays().finish(upload, std::move(**incoming)));
  v1::ApplyRequest request;
  request.set_scene(scene->id);
  request.set_number(1);
  v1::Mesh& mesh = *request.mutable_transaction()->add_edits()->mutable_mesh();
  *mesh.mutable_positions() = f32({3, 3}, {});
  mesh.mutable_positions()->set_upload("positions");
  *mesh.mutable_indices() = u32s({1, 3}, {0, 1, 2});
  vfs().write_error = SQLITE_FULL;
  for (int attempt = 0; attempt < 2; ++attempt) REQUIRE(!*apply(server, session, request));
  vfs().write_error = SQLITE_OK;
  CHECK(seconds_until_written(server) < 3);
  const auto reply = apply(server, session, request);
  INFO((*reply ? "" : reply->error().message));
  REQUIRE(*reply);
  request.set_number(2);
  CHECK(apply(server, session, request)->error().code == Code::kNotFound);  // used up
}

TEST_CASE("journal: after a loss of power every edit acknowledged as fsync is there") {
  vfs();
  std::mt19937 random(11);
  const Folder folder;
  Server server(folder.path(), 60);
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK_SYNCED);
  std::map<u64, std::string> states{{0, fingerprint(*scene->scene.head())}};
  u32 lost = 0, wrong = 0, refused = 0;
  constexpr u64 kEdits = 200;
  for (u64 number = 1; number <= kEdits; ++number) {
    REQUIRE(*apply(server, session, placed(scene->id, number, "a", float(number))));
    states[number] = fingerprint(*scene->scene.head());
    if (number % 4 != 0) continue;
    // The files are of one moment: a snapshot that is made meanwhile comes whole or not at all.
    std::string before;
    std::unique_ptr<Folder> after;
    while (before.empty() || before != contents(folder)) {
      before = contents(folder);
      after = std::make_unique<Folder>();
      lose_power(folder, *after, random);
    }
    Server next(after->path());
    if (!next.opened) {
      UNSCOPED_INFO(next.opened.error().message);
      ++refused;
      continue;
    }
    const auto found = next.daemon.scenes.open("room", *next.session());
    const auto head = found ? (*found)->scene.head() : std::make_shared<const Snapshot>();
    lost += head->revision < number ? 1 : 0;
    wrong += fingerprint(*head) != states[head->revision] ? 1 : 0;
  }
  fmt::print("loss of power: {} cuts, {} lost, {} wrong, {} refused\n", kEdits / 4, lost, wrong,
             refused);
  CHECK(lost == 0);
  CHECK(wrong == 0);
  CHECK(refused == 0);
}
