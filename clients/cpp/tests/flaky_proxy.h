// A Unix socket in front of a daemon's, which loses connections and replies on demand.
#pragma once

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace heliograph::client {

/// Connect to address() instead of the daemon's; the local channel is the daemon's own.
class FlakyProxy {
 public:
  explicit FlakyProxy(const std::string& daemon) : daemon_(daemon.substr(std::strlen("unix://"))) {
    std::string folder = "/tmp/heliograph-proxy-XXXXXX";
    if (::mkdtemp(folder.data()) == nullptr) throw std::runtime_error("no folder");
    folder_ = folder;
    path_ = folder_ + "/socket";
    std::filesystem::create_symlink(daemon_ + ".fd.sock", path_ + ".fd.sock");
    listener_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_un address = address_of(path_);
    if (::bind(listener_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
        ::listen(listener_, 16) != 0)
      throw std::runtime_error("no socket");
    acceptor_ = std::thread([this] { accept(); });
  }

  ~FlakyProxy() {
    is_over_ = true;
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    cut();
    for (std::thread& pump : pumps_) pump.join();
    for (const int fd : closed_) ::close(fd);
    ::close(listener_);
    std::filesystem::remove_all(folder_);
  }
  FlakyProxy(const FlakyProxy&) = delete;
  FlakyProxy& operator=(const FlakyProxy&) = delete;

  [[nodiscard]] std::string address() const { return "unix://" + path_; }
  /// Drops replies of the daemon from now on, or passes them on.
  void lose_replies(bool lost) { loses_ = lost; }
  /// Ends all connections.
  void cut() {
    const std::lock_guard lock(mutex_);
    for (const int fd : open_) ::shutdown(fd, SHUT_RDWR);
    closed_.insert(closed_.end(), open_.begin(), open_.end());
    open_.clear();
  }

 private:
  static sockaddr_un address_of(const std::string& path) {
    sockaddr_un out{};
    out.sun_family = AF_UNIX;
    std::copy(path.begin(), path.end(), out.sun_path);
    return out;
  }

  void accept() {
    for (;;) {
      const int client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (client < 0 || is_over_) return;
      const int server = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
      const sockaddr_un address = address_of(daemon_);
      if (::connect(server, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0)
        return;
      const std::lock_guard lock(mutex_);
      open_.push_back(client);
      open_.push_back(server);
      pumps_.emplace_back([this, client, server] { pump(client, server, false); });
      pumps_.emplace_back([this, client, server] { pump(server, client, true); });
    }
  }

  void pump(int from, int to, bool is_reply) {
    std::array<char, 65536> buffer;
    for (ssize_t size = 0; (size = ::recv(from, buffer.data(), buffer.size(), 0)) > 0;) {
      if (is_reply && loses_) continue;
      for (ssize_t at = 0; at < size;) {
        const ssize_t sent = ::send(to, buffer.data() + at, std::size_t(size - at), MSG_NOSIGNAL);
        if (sent <= 0) break;
        at += sent;
      }
    }
    ::shutdown(to, SHUT_RDWR);
  }

  std::string daemon_;
  std::string folder_;
  std::string path_;
  int listener_ = -1;
  std::atomic<bool> loses_{false};
  std::atomic<bool> is_over_{false};
  std::thread acceptor_;
  std::mutex mutex_;  // of what follows
  std::vector<int> open_, closed_;
  std::vector<std::thread> pumps_;
};

}  // namespace heliograph::client
