// Numbered edits are applied exactly once, whatever happens to the connection.
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstring>
#include <functional>
#include <thread>

#include "fixture.h"
#include "flaky_proxy.h"

using namespace heliograph::client;
using namespace std::chrono_literals;

namespace {

Receipt advance(Scene& scene, double dt) {
  Transaction edit = scene.edit();
  edit.advance(dt);  // twice would show
  return edit.commit_later();
}

/// Work beside the test, until the end of the block.
class Beside {
 public:
  explicit Beside(
      std::function<void()> work, std::function<void()> end = [] {})
      : end_(std::move(end)), thread_(std::move(work)) {}
  Beside(const Beside&) = delete;
  Beside& operator=(const Beside&) = delete;
  ~Beside() {
    end_();
    thread_.join();
  }

 private:
  const std::function<void()> end_;
  std::thread thread_;
};

/// The process that listens at "unix:///path".
pid_t listener_of(const std::string& address) {
  sockaddr_un path{};
  path.sun_family = AF_UNIX;
  address.copy(path.sun_path, sizeof(path.sun_path) - 1, std::strlen("unix://"));
  const int probe = ::socket(AF_UNIX, SOCK_STREAM, 0);
  REQUIRE(::connect(probe, reinterpret_cast<const sockaddr*>(&path), sizeof(path)) == 0);
  ucred peer{};
  socklen_t size = sizeof(peer);
  REQUIRE(::getsockopt(probe, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0);
  ::close(probe);
  return peer.pid;
}

/// An address whose local channel gives a ticket that no daemon knows, once; then it is the
/// daemon's.
class StaleTicket {
 public:
  explicit StaleTicket(const std::string& daemon)
      : daemon_(daemon.substr(std::strlen("unix://"))), folder_("/tmp/heliograph-stale-XXXXXX") {
    REQUIRE(::mkdtemp(folder_.data()) != nullptr);
    std::filesystem::create_symlink(daemon_, folder_ + "/socket");
    sockaddr_un path{};
    path.sun_family = AF_UNIX;
    second().copy(path.sun_path, sizeof(path.sun_path) - 1);
    listener_ = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    REQUIRE(::bind(listener_, reinterpret_cast<const sockaddr*>(&path), sizeof(path)) == 0);
    REQUIRE(::listen(listener_, 1) == 0);
    thread_ = std::thread([this] { give(); });
  }
  StaleTicket(const StaleTicket&) = delete;
  StaleTicket& operator=(const StaleTicket&) = delete;
  ~StaleTicket() {
    ::shutdown(listener_, SHUT_RDWR);
    thread_.join();
    ::close(listener_);
    std::filesystem::remove_all(folder_);
  }
  [[nodiscard]] std::string address() const { return "unix://" + folder_ + "/socket"; }

 private:
  [[nodiscard]] std::string second() const { return folder_ + "/socket.fd.sock"; }
  void give() const {
    const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    std::filesystem::remove(second());
    std::filesystem::create_symlink(daemon_ + ".fd.sock", second());
    const std::string ticket(16, 'x');
    ::send(client, ticket.data(), ticket.size(), MSG_NOSIGNAL);
    ::close(client);
  }

  std::string daemon_, folder_;
  int listener_ = -1;
  std::thread thread_;
};

}  // namespace

TEST_CASE("a ticket of a daemon that ended is asked for again") {
  const StaleTicket stale(client().address());
  Client late = connect(stale.address());
  CHECK(late.info().tenant == client().info().tenant);
  CHECK_FALSE(late.info().tenant.empty());
  CHECK(late.info().weight == 1);
}

TEST_CASE("edits whose replies were lost are answered, not applied again") {
  FlakyProxy proxy(client().address());
  Client flaky = connect(proxy.address());
  Scene scene = flaky.create_scene("lost replies", Lifetime::kDaemon);
  const Scene seen = client().open_scene("lost replies");
  advance(scene, 1).wait();
  proxy.lose_replies(true);
  std::vector<Receipt> receipts;
  for (int i = 0; i < 50; ++i) receipts.push_back(advance(scene, 1));
  for (int i = 0; i < 500 && seen.time() < 51; ++i) std::this_thread::sleep_for(10ms);
  REQUIRE(seen.time() == 51);  // all were applied, and the client does not know
  proxy.lose_replies(false);
  proxy.cut();
  const auto first = receipts.front().wait();
  for (std::size_t i = 0; i < receipts.size(); ++i) CHECK(receipts[i].wait() == first + i);
  CHECK(seen.time() == 51);
  scene.remove();
}

TEST_CASE("a refusal that was lost is refused again, once") {
  FlakyProxy proxy(client().address());
  Client flaky = connect(proxy.address());
  Scene scene = flaky.create_scene();
  advance(scene, 1).wait();
  proxy.lose_replies(true);
  Transaction wrong = scene.edit();
  wrong.update("nobody", Components());
  Receipt refused = wrong.commit_later();
  Receipt good = advance(scene, 1);
  std::this_thread::sleep_for(100ms);
  proxy.lose_replies(false);
  proxy.cut();
  CHECK(error_of([&] { refused.wait(); }).code() == Code::kNotFound);
  good.wait();
  CHECK(scene.time() == 2);
}

TEST_CASE("connections that break all the time lose and double nothing") {
  FlakyProxy proxy(client().address());
  Client flaky = connect(proxy.address());
  Scene scene = flaky.create_scene();
  std::atomic<int> acknowledged{0};
  std::atomic<bool> is_over{false};
  // Cuts every 15 ms, and half as often each time that nothing came through.
  const Beside saboteur(
      [&] {
        auto pause = 15ms;
        for (int seen = 0; !is_over; seen = acknowledged) {
          std::this_thread::sleep_for(pause);
          pause = acknowledged > seen ? 15ms : 2 * pause;
          proxy.cut();
        }
      },
      [&] { is_over = true; });
  constexpr int kEdits = 3000;
  std::vector<Receipt> receipts;
  for (int i = 0; i < kEdits; ++i) {
    receipts.push_back(advance(scene, 1));
    if (i % 8 == 0) {
      receipts.back().wait();
      acknowledged = i;
    }
  }
  std::uint64_t last = 0;
  for (Receipt& receipt : receipts) last = receipt.wait();
  CHECK(last == kEdits);
  CHECK(scene.revision() == kEdits);
  CHECK(scene.time() == kEdits);
}

TEST_CASE("creations are repeated too, and done once") {
  FlakyProxy proxy(client().address());
  Client flaky = connect(proxy.address());
  const std::size_t before = flaky.scenes().size();
  proxy.lose_replies(true);
  const Beside repair([&] {
    std::this_thread::sleep_for(100ms);
    proxy.lose_replies(false);
    proxy.cut();
  });
  const Scene scene = flaky.create_scene();
  CHECK(flaky.scenes().size() == before + 1);
}

TEST_CASE("several threads edit several scenes of one client") {
  std::vector<Scene> scenes;
  for (int i = 0; i < 6; ++i) scenes.push_back(client().create_scene());
  std::vector<std::thread> threads;
  for (int t = 0; t < 6; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < 100; ++i) {
        Receipt mine = advance(scenes[std::size_t(t)], 1);
        advance(scenes[std::size_t(t + 1) % 6], 1).wait();
        mine.wait();
      }
    });
  for (std::thread& thread : threads) thread.join();
  for (const Scene& scene : scenes) CHECK(scene.time() == 200);
}

TEST_CASE("a private daemon that is killed says how it ended") {
  Client own = launch();
  Scene scene = own.create_scene();
  REQUIRE(::kill(listener_of(own.address()), SIGKILL) == 0);
  const ClientError error = error_of([&] { advance(scene, 1).wait(); });
  CHECK(error.code() == Code::kUnavailable);
  REQUIRE(error.details().exit_code);
  CHECK(*error.details().exit_code == -9);
}
