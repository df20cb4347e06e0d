// The second socket of a local session: the session lives as long as it does. Called by Session.
#pragma once

#include <memory>
#include <string>

namespace heliograph::client::wire {

/// Owns: the socket. A platform without such sockets throws kUnimplemented.
class Lifeline {
 public:
  /// Connects to "<socket>.fd.sock", waiting up to `seconds` for a daemon that starts.
  Lifeline(const std::string& path, double seconds);
  ~Lifeline();
  Lifeline(const Lifeline&) = delete;
  Lifeline& operator=(const Lifeline&) = delete;

  /// Binds a session to this socket, once.
  [[nodiscard]] const std::string& ticket() const { return ticket_; }

 private:
  [[maybe_unused]] int socket_ = -1;  // on platforms that have such sockets
  std::string ticket_;
};

}  // namespace heliograph::client::wire
