// A journal cut off and with flipped bits, anywhere: it opens with a state that was acknowledged,
// or names what is damaged; a state that is not the last one is never shown without a word.
#include "server/journal/journal.h"
#include "tests/unit/journal_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

bool is_long() { return std::getenv("HELIOGRAPH_LONG") != nullptr; }

std::string read(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}
void write(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// What a damaged copy came to.
struct Tally {
  u32 opened = 0, shorter = 0, named = 0, silent = 0, wrong = 0;
};

/// A state directory as a crash left it, and the scene at each of its revisions.
struct Crashed {
  Folder folder;
  std::map<u64, std::string> states;
  u64 last = 0;
};

void make(Crashed& crashed, u64 edits) {
  const Folder folder;
  Server server(folder.path(), 150);
  REQUIRE(server.opened);
  const auto session = server.session();
  const ScenePtr scene = server.create(*session, "room", v1::LIFETIME_DISK);
  crashed.states[0] = fingerprint(*scene->scene.head());
  for (u64 number = 1; number <= edits; ++number) {
    REQUIRE(*apply(server, session,
                   placed(scene->id, number, fmt::format("e{}", number % 7), float(number))));
    crashed.states[number] = fingerprint(*scene->scene.head());
    // The last snapshot is made, and leaves an empty log, before the last of them.
    if (number == edits - 90) std::this_thread::sleep_for(std::chrono::seconds(1));
  }
  crashed.last = edits;
  crashed.folder.copy(folder.path());
}

void open(const Folder& folder, const Crashed& crashed, Tally& tally) {
  Server server(folder.path());
  if (!server.opened) {
    ++tally.named;
    tally.silent += server.opened.error().message.size() < 10 ? 1 : 0;
    return;
  }
  ++tally.opened;
  const auto found = server.daemon.scenes.open("room", *server.session());
  if (!found) {
    tally.silent += server.daemon.journal->damage().empty() ? 1 : 0;
    return;
  }
  const auto head = (*found)->scene.head();
  tally.wrong += fingerprint(*head) != crashed.states.at(head->revision) ? 1 : 0;
  if (head->revision == crashed.last) return;
  ++tally.shorter;
  tally.silent += server.daemon.journal->damage().empty() ? 1 : 0;
}

}  // namespace

TEST_CASE("journal torture: cut off at every byte of its end") {
  Crashed crashed;
  make(crashed, 400);
  const std::string log = read(crashed.folder / "journal.db-wal");
  REQUIRE(log.size() > 8192);
  Tally tally;
  const Folder copy;
  u32 cuts = 0;
  for (u64 cut = 1; cut <= 4096; cut += is_long() ? 1 : 61, ++cuts) {
    copy.copy(crashed.folder.path());
    write(copy / "journal.db-wal", log.substr(0, log.size() - cut));
    open(copy, crashed, tally);
  }
  fmt::print("cut off: {} cuts, {} opened, {} of them shorter, {} named, {} wrong\n", cuts,
             tally.opened, tally.shorter, tally.named, tally.wrong);
  CHECK(tally.opened == cuts);
  CHECK(tally.wrong == 0);
}

TEST_CASE("journal torture: flipped bits") {
  Crashed crashed;
  make(crashed, 400);
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(crashed.folder.path()))
    if (entry.is_regular_file() && entry.file_size() > 0)
      files.push_back(std::filesystem::relative(entry.path(), crashed.folder.path()).string());
  std::mt19937 random(5);
  Tally tally;
  const Folder copy;
  const u32 flips = is_long() ? 1000 : 100;
  for (u32 flip = 0; flip < flips; ++flip) {
    copy.copy(crashed.folder.path());
    const std::string& file = files[random() % files.size()];
    std::string bytes = read(copy / file);
    bytes[random() % bytes.size()] ^= char(1 << (random() % 8));
    write(copy / file, bytes);
    INFO(file);
    open(copy, crashed, tally);
  }
  fmt::print(
      "flipped: {} bits in {} files, {} opened, {} of them shorter, {} named, {} silent, "
      "{} wrong\n",
      flips, files.size(), tally.opened, tally.shorter, tally.named, tally.silent, tally.wrong);
  CHECK(tally.silent == 0);
  CHECK(tally.wrong == 0);
}
