// The daemon's handle on one heliograph-decode: starts it, hands it its job, gets its result.
#pragma once

#include <sys/types.h>

#include <memory>
#include <string>

#include "server/decode/decoder.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// A process for one job, with an address layout of its own. It confines itself as soon as it runs,
/// and ends when the thread ends that started it. Owns: the process (killed and reaped at the end),
/// its socket and both regions. Thread: one at a time.
class ChildProcess {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<ChildProcess>> start(const DecoderOptions& options);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;

  [[nodiscard]] int socket() const { return socket_.get(); }
  /// While it has nothing to say.
  [[nodiscard]] bool has_ended() const;
  /// Hands it the job.
  [[nodiscard]] Status begin(const google::protobuf::MessageLite& job,
                             std::span<const Bytes> files);
  /// Lets it write a result of at most so many bytes.
  [[nodiscard]] Status grant(u64 bytes);
  /// What it wrote.
  [[nodiscard]] Expected<std::shared_ptr<const Region>> result() const;
  /// Kills it unless it ended: "was killed by SIGSEGV", "exited with 1".
  [[nodiscard]] std::string how_it_ended();

 private:
  ChildProcess(pid_t process, Fd socket, Fd job, Fd result)
      : process_(process),
        socket_(std::move(socket)),
        job_(std::move(job)),
        result_(std::move(result)) {}
  [[nodiscard]] int reap();

  pid_t process_;  // 0: it is reaped
  const Fd socket_, job_, result_;
  u64 granted_ = 0;
};

}  // namespace heliograph::server
