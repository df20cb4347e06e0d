// Durable scenes, as a client sees a restart of the daemon.
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <thread>

#include "fixture.h"

extern char** environ;

using namespace heliograph::client;
using namespace std::chrono_literals;

namespace {

/// A daemon with a state directory, which is killed and started again.
class Durable {
 public:
  Durable() {
    std::string folder = "/tmp/heliograph-durable-XXXXXX";
    if (::mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no folder");
    folder_ = folder;
    start();
  }
  Durable(const Durable&) = delete;
  Durable& operator=(const Durable&) = delete;
  ~Durable() {
    kill();
    std::filesystem::remove_all(folder_);
  }

  [[nodiscard]] std::string address() const { return "unix://" + socket(); }

  void start() {
    const std::array<std::string, 5> words{std::getenv("HELIOGRAPHD"), "--socket", socket(),
                                           "--state-dir", folder_ + "/state"};
    std::array<char*, 6> arguments{};
    for (std::size_t i = 0; i < words.size(); ++i)
      arguments[i] = const_cast<char*>(words[i].c_str());
    REQUIRE(::posix_spawn(&pid_, arguments[0], nullptr, nullptr, arguments.data(), environ) == 0);
    for (int i = 0; i < 1000; ++i) {
      std::this_thread::sleep_for(10ms);
      try {
        connect(address());
        return;
      } catch (const ClientError&) {
      }
    }
    FAIL("the daemon does not listen");
  }
  void kill() const {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
  }
  void restart() {
    kill();
    start();
  }

 private:
  [[nodiscard]] std::string socket() const { return folder_ + "/run/heliograph.sock"; }
  std::string folder_;
  pid_t pid_ = -1;
};

Entity place(Scene& scene, const std::string& name, double x) {
  Transaction edit = scene.edit();
  Entity entity = edit.entity(name, Components().transform(Pose(Vec3{x, 0, 0})));
  edit.commit();
  return entity;
}

}  // namespace

TEST_CASE("durable: a client goes on after the daemon was killed") {
  Durable daemon;
  Client own = connect(daemon.address());
  CHECK(own.info().journal == Journal::kWriting);
  Scene scene = own.create_scene("room", Lifetime::kDiskSynced);
  CHECK(scene.lifetime() == Lifetime::kDiskSynced);
  const std::uint64_t id = place(scene, "thing", 1).id();
  daemon.restart();
  CHECK(scene.revision() == 1);  // a call that resumes the session
  CHECK(place(scene, "thing", 2).id() == id);
  daemon.restart();
  CHECK(place(scene, "thing", 3).id() == id);  // an edit that does
  CHECK(scene.revision() == 3);
}

TEST_CASE("durable: edits on their way when the daemon is killed are applied once") {
  Durable daemon;
  Client own = connect(daemon.address());
  Scene scene = own.create_scene("room", Lifetime::kDisk);
  std::vector<Receipt> receipts;
  for (int round = 0; round < 3; ++round) {
    for (int i = 0; i < 40; ++i) {
      Transaction edit = scene.edit();
      edit.advance(1);  // twice would show
      receipts.push_back(edit.commit_later());
    }
    receipts[receipts.size() - 20].wait();
    daemon.restart();
  }
  for (std::size_t i = 0; i < receipts.size(); ++i) CHECK(receipts[i].wait() == i + 1);
  CHECK(scene.time() == 120);
}

TEST_CASE("durable: what was not is gone, branches are when they are asked to be") {
  Durable daemon;
  Client own = connect(daemon.address());
  Scene plain = own.create_scene("plain", Lifetime::kDaemon);
  CHECK(plain.lifetime() == Lifetime::kDaemon);
  place(plain, "thing", 1);
  const Scene branch = plain.branch("kept", {}, Lifetime::kDisk);
  const Scene lost = plain.branch("lost", {}, Lifetime::kDaemon);
  const std::string file = daemon.address().substr(7) + ".scene";
  plain.save(file);
  const Scene loaded = own.load_scene(file, "loaded", Lifetime::kDiskSynced);
  daemon.restart();
  CHECK(error_of([&] { place(plain, "thing", 2); }).code() == Code::kNotFound);
  std::vector<std::string> names;
  for (const Scene& scene : own.scenes()) names.push_back(scene.name());
  std::sort(names.begin(), names.end());
  CHECK(names == std::vector<std::string>{"kept", "loaded"});
  CHECK(branch.contains("thing"));
  CHECK(loaded.lifetime() == Lifetime::kDiskSynced);
}

TEST_CASE("durable: a stream of frames is told that the daemon was restarted, once") {
  Durable daemon;
  Client own = connect(daemon.address());
  Scene scene = own.create_scene("room", Lifetime::kDisk);
  Transaction edit = scene.edit();
  edit.entity("cam", Components().camera(Camera::from_fov(degrees(50), 16, 16)));
  edit.commit();
  daemon.restart();
  const RenderOptions options = RenderOptions().planes({"depth"});
  const ClientError error = error_of([&] { (void)scene.render("cam", options); });
  CHECK(error.code() == Code::kUnavailable);
  CHECK(contains(error.what(), "ask again"));
  CHECK(scene.render("cam", options).info().revision == 1);
}

TEST_CASE("durable: a daemon without a state directory refuses") {
  const auto error = error_of([] { client().create_scene("room", Lifetime::kDisk); });
  CHECK(error.code() == Code::kFailedPrecondition);
  CHECK(client().info().journal == Journal::kNone);
}
