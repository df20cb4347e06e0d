// The local channel of a session: the session lives as long as this connection. Called by Session.
#pragma once

#include <memory>
#include <string>

namespace heliograph::client::wire {

/// Owns: the socket. Throws kUnimplemented on platforms other than Linux.
class LocalChannel {
 public:
  /// Connects to "<socket>.fd.sock" and receives the ticket; throws kUnavailable after `seconds`.
  LocalChannel(const std::string& path, double seconds);
  ~LocalChannel();
  LocalChannel(const LocalChannel&) = delete;
  LocalChannel& operator=(const LocalChannel&) = delete;

  /// The ticket, 16 bytes, that binds one session to this connection.
  [[nodiscard]] const std::string& ticket() const { return ticket_; }

 private:
  [[maybe_unused]] int socket_ = -1;  // on platforms that have such sockets
  std::string ticket_;
};

}  // namespace heliograph::client::wire
