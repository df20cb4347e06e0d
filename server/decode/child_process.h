// The daemon's handle of one heliograph-decode: starts it, passes the job, receives the result.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

#include "server/decode/decoder.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// A process for one job, with an address layout of its own. It confines itself as it starts, and
/// dies with the thread that started it. Owns: the process (killed and reaped by the destructor),
/// its socket and both regions. Thread: one at a time.
class ChildProcess {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<ChildProcess>> start(const DecoderOptions& options);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;

  [[nodiscard]] int socket() const { return socket_.get(); }
  /// True if the process has ended; to be asked while it has nothing to report.
  [[nodiscard]] bool has_ended() const;
  /// Sends the job.
  [[nodiscard]] Status begin(const google::protobuf::MessageLite& job,
                             std::span<const Bytes> files);
  /// Allows a result of at most so many bytes.
  [[nodiscard]] Status grant(u64 bytes);
  /// Returns the result that it wrote.
  [[nodiscard]] Expected<std::shared_ptr<const Region>> result() const;
  /// Ends it and returns how: "was killed by SIGSEGV", "exited with 1".
  [[nodiscard]] std::string how_it_ended();

 private:
  ChildProcess(pid_t process, Fd socket, Fd job, Fd result)
      : process_(process),
        socket_(std::move(socket)),
        job_(std::move(job)),
        result_(std::move(result)) {}
  [[nodiscard]] int reap();

  pid_t process_;  // 0: reaped
  const Fd socket_, job_, result_;
  u64 granted_ = 0;
};

}  // namespace heliograph::server
