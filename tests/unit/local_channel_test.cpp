// The local channel: what one process may have of it, and that what it sends holds up nobody else.
#include "server/net/local_channel.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <atomic>
#include <filesystem>
#include <thread>

#include "server/os/packet.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using std::chrono::milliseconds;

namespace {

/// A local channel in a folder of its own, with a loop that runs in a thread of its own.
struct Daemon {
  const std::string folder;
  const std::string path = folder + "/fd.sock";
  std::atomic<bool> is_held = false;  // then closing a descriptor hangs
  std::unique_ptr<EventLoop> loop = *EventLoop::create([this](const UniqueFd&) {
    while (is_held) std::this_thread::sleep_for(milliseconds(1));
  });
  const UniqueFd nowhere{::open("/dev/null", O_WRONLY | O_CLOEXEC)};
  const Log log{"off", false, {}, nowhere.get()};
  std::unique_ptr<LocalChannel> channel;
  std::thread thread;

  explicit Daemon(LocalChannel::Limits limits)
      : folder(std::filesystem::temp_directory_path() /
               ("heliograph-local-channel-" + std::to_string(::getpid()))) {
    auto listener = listen_unix(path, SOCK_SEQPACKET, std::nullopt);
    REQUIRE(listener);
    auto started =
        LocalChannel::start(*loop, log, std::move(*listener), limits,
                            {[](u64) {}, [](u64, const BufferMessage&, const ForeignFd&) {}});
    REQUIRE(started);
    channel = std::move(*started);
    thread = std::thread([this] { loop->run(); });
  }
  ~Daemon() {
    loop->quit();
    thread.join();
    channel.reset();
    std::filesystem::remove_all(folder);
  }
  [[nodiscard]] UniqueFd connect() const {
    UniqueFd fd(::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0));
    const timeval patience{.tv_sec = 5, .tv_usec = 0};
    ::setsockopt(fd.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof address.sun_path - 1);
    REQUIRE(::connect(fd.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) == 0);
    return fd;
  }
};

/// The next packet; "": the other end closed the connection.
std::string received(const UniqueFd& fd) {
  std::array<char, 64> data{};
  const ssize_t size = ::recv(fd.get(), data.data(), data.size(), 0);
  REQUIRE((size >= 0 || errno == ECONNRESET));
  return {data.data(), std::size_t(std::max<ssize_t>(size, 0))};
}

}  // namespace

TEST_CASE("local channel: one process has its share") {
  Daemon daemon({.total = 8, .per_peer = 2});
  auto first = daemon.connect();
  const auto second = daemon.connect();
  CHECK(received(first).size() == 16);
  CHECK(received(second).size() == 16);
  CHECK(received(daemon.connect()).empty());
  first.reset();
  std::string ticket;  // once the loop has seen that it is gone
  for (int i = 0; i < 500 && ticket.empty(); ++i) {
    ticket = received(daemon.connect());
    std::this_thread::sleep_for(milliseconds(5));
  }
  CHECK(ticket.size() == 16);
}

TEST_CASE("local channel: one that no session has ends after a while, and its ticket with it") {
  Daemon daemon({.unbound = std::chrono::seconds(1)});
  const auto bound = daemon.connect(), unbound = daemon.connect();
  const std::string used = received(bound), unused = received(unbound);
  REQUIRE(daemon.channel->bind(used, 7));
  CHECK(received(unbound).empty());
  CHECK_FALSE(daemon.channel->bind(unused, 8));
  CHECK(daemon.channel->send(7, {}, nullptr));
  CHECK(received(bound).size() == sizeof(BufferMessage));
}

TEST_CASE(
    "local channel: a process whose descriptors hang is refused, and needs no lane for that") {
  Daemon daemon({});
  Closer& closer = daemon.loop->closer();
  const auto me = u64(::getpid());
  daemon.is_held = true;
  while (!closer.is_full(me)) closer.close(UniqueFd(::open("/dev/null", O_RDONLY | O_CLOEXEC)), me);
  const u32 open = closer.open();
  for (int i = 0; i < 10; ++i) CHECK(received(daemon.connect()).empty());
  CHECK(closer.open() == open);
  daemon.is_held = false;
  std::string ticket;
  for (int i = 0; i < 500 && ticket.empty(); ++i) ticket = received(daemon.connect());
  CHECK(ticket.size() == 16);
}
