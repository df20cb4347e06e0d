// Descriptors of others are closed without waiting for them.
#include "server/os/closer.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <chrono>
#include <thread>

#include "server/os/packet.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using Clock = std::chrono::steady_clock;

namespace {

/// A connection whose close() waits for `linger` seconds, because its other end reads nothing.
struct Stuck {
  UniqueFd listener, peer, socket;

  explicit Stuck(int linger) {
    listener = UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const int small = 4096;
    ::setsockopt(listener.get(), SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* any = reinterpret_cast<sockaddr*>(&address);
    REQUIRE(::bind(listener.get(), any, size) == 0);
    REQUIRE(::listen(listener.get(), 1) == 0);
    REQUIRE(::getsockname(listener.get(), any, &size) == 0);
    socket = UniqueFd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    REQUIRE(::connect(socket.get(), any, size) == 0);
    peer = UniqueFd(::accept(listener.get(), nullptr, nullptr));
    const std::array<char, 65536> bytes{};
    while (::send(socket.get(), bytes.data(), bytes.size(), MSG_DONTWAIT) > 0) {
    }
    const ::linger wait{.l_onoff = 1, .l_linger = linger};
    ::setsockopt(socket.get(), SOL_SOCKET, SO_LINGER, &wait, sizeof wait);
  }
};

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void await(const auto& condition) {
  const auto start = Clock::now();
  while (!condition() && seconds_since(start) < 5)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  REQUIRE(condition());
}

}  // namespace

TEST_CASE("closer: what lingers is closed at once, and the caller does not wait") {
  Closer closer{Closer::Limits{.lanes = 1}};
  Stuck stuck(20);
  const auto start = Clock::now();
  closer.close(std::move(stuck.socket));
  CHECK(seconds_since(start) < 1);
  await([&] { return closer.open() == 0; });
  CHECK(seconds_since(start) < 5);
}

TEST_CASE("closer: who sends what hangs waits for itself alone") {
  std::atomic<bool> is_held = true;
  const int hangs = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
  Closer closer({.lanes = 2, .waiting = 2, .open = 4}, [&](const UniqueFd& fd) {
    while (fd.get() == hangs && is_held) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  const auto any = [] { return UniqueFd(::open("/dev/null", O_RDONLY | O_CLOEXEC)); };
  closer.close(UniqueFd(hangs), 1);
  for (int i = 0; i < 2; ++i) closer.close(any(), 1);
  CHECK(closer.is_full(1));
  for (int i = 0; i < 100; ++i) {  // others' go meanwhile
    closer.close(any(), 2);
    CHECK_FALSE(closer.is_full(2));
    await([&] { return closer.open() == 3; });
  }
  CHECK_FALSE(closer.is_full());
  closer.close(any(), 1);
  CHECK(closer.is_full());
  is_held = false;
  await([&] { return closer.open() == 0; });
  CHECK_FALSE(closer.is_full(1));
  CHECK_FALSE(closer.is_full());
}

TEST_CASE("packets: each descriptor that came is taken, more than one too") {
  Closer closer{Closer::Limits()};
  std::array<int, 2> pair{};
  REQUIRE(::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, pair.data()) == 0);
  const UniqueFd sender(pair[0]);
  const ForeignFd receiver(closer, UniqueFd(pair[1]));
  constexpr std::size_t kMany = 253;
  alignas(cmsghdr) std::array<char, CMSG_SPACE(kMany * sizeof(int))> control{};
  char byte = 7;
  iovec piece{&byte, 1};
  msghdr message{};
  message.msg_iov = &piece;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  cmsghdr* header = CMSG_FIRSTHDR(&message);
  header->cmsg_level = SOL_SOCKET;
  header->cmsg_type = SCM_RIGHTS;
  header->cmsg_len = CMSG_LEN(kMany * sizeof(int));
  std::array<int, kMany> fds;
  fds.fill(sender.get());
  std::memcpy(CMSG_DATA(header), fds.data(), sizeof fds);
  REQUIRE(::sendmsg(sender.get(), &message, 0) == 1);
  std::array<char, 8> data{};
  const auto packet = receive_packet(receiver, data, MSG_DONTWAIT, closer);
  CHECK(packet.size == 1);
  CHECK(packet.descriptors.size() == kMany);
}
