// What a decode child may still do: compute, use the memory it may use, and write to the
// descriptors it holds. Entered by the children of the zygote, and by the tests.
#pragma once

#include <string>
#include <vector>

#include "renderer/base/error.h"
#include "renderer/base/types.h"

namespace heliograph::server {

struct SandboxLimits {
  u64 memory_bytes = 2ull << 30;  // address space
  u32 cpu_seconds = 20;
  u64 file_bytes = 1ull << 30;  // of a memfd it makes
};

struct SandboxReport {
  std::vector<std::string> active;   // "namespaces", "rlimits", "landlock", "seccomp"
  std::vector<std::string> refused;  // "namespaces: Operation not permitted"
};

/// Owns: the compiled seccomp filter, made once and inherited by fork.
class Sandbox {
 public:
  [[nodiscard]] static Expected<Sandbox> prepare(const SandboxLimits& limits);
  Sandbox(Sandbox&& other) noexcept;
  Sandbox& operator=(Sandbox&&) = delete;
  ~Sandbox();

  /// Confines this process for good, and ties its life to its parent's. Each layer stands alone:
  /// one that the kernel refuses is reported, the others still hold. The caller has one thread.
  ///
  /// namespaces  new user, network, mount and IPC namespace: no network device at all
  /// rlimits     address space, CPU, file size, 16 descriptors, no core dump
  /// landlock    no path can be opened, no TCP port, no abstract socket
  /// seccomp     an allowlist of system calls; others answer EPERM, opening ENOENT
  [[nodiscard]] SandboxReport enter() const;

 private:
  explicit Sandbox(const SandboxLimits& limits, void* filter) : limits_(limits), filter_(filter) {}
  SandboxLimits limits_;
  void* filter_;
};

}  // namespace heliograph::server
