// The daemon's handle on the zygote: starts it, hands it jobs, starts it again when it died.
#pragma once

#include <sys/types.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "server/decode/decoded.pb.h"
#include "server/decode/decoder.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// One zygote process. Owns: the process (killed and reaped at the end) and its control socket.
class ZygoteProcess {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<ZygoteProcess>> start(
      const DecoderOptions& options);
  ~ZygoteProcess();
  ZygoteProcess(const ZygoteProcess&) = delete;

  /// Fails with UNAVAILABLE when the zygote is gone. Thread: any.
  [[nodiscard]] Status launch(int job_socket, int job_region, int result_region) const;

  /// What it said of itself; waits for that at most `seconds`. Thread: any.
  [[nodiscard]] decode::Hello hello(double seconds) const;

 private:
  ZygoteProcess(pid_t process, Fd control) : process_(process), control_(std::move(control)) {}
  const pid_t process_;
  const Fd control_;
  mutable std::mutex mutex_;  // of hello_
  mutable std::optional<decode::Hello> hello_;
};

}  // namespace heliograph::server
