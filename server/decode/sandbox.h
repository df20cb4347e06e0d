// Confinement of a decode child to computing, using its limited memory, and writing to its
// descriptors. Entered by heliograph-decode before it reads a file, and by the tests.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "renderer/base/error.h"
#include "renderer/base/types.h"

namespace heliograph::server {

struct SandboxLimits {
  u64 memory_bytes = 2ull << 30;  // address space
  u32 cpu_seconds = 20;
  u64 file_bytes = 1ull << 30;  // growth of a memfd: 0 until the parent raises it
};

struct SandboxReport {
  std::vector<std::string> active;   // names of layers in force
  std::vector<std::string> refused;  // refused by the kernel: "namespaces: Operation not permitted"
};

/// Owns: the compiled seccomp filter.
class Sandbox {
 public:
  /// Compiles the filter. INTERNAL: the kernel has no seccomp, or none that covers all threads.
  [[nodiscard]] static Expected<Sandbox> prepare(const SandboxLimits& limits);
  Sandbox(Sandbox&& other) noexcept;
  Sandbox& operator=(Sandbox&&) = delete;
  ~Sandbox();

  /// Confines this process for good, and ties its life to its parent's. It tries every layer and
  /// reports those that the kernel refuses: the caller decides whether to go on. The caller has one
  /// thread; `start_threads` starts those it will ever have.
  ///
  /// namespaces           new user, network, mount and IPC namespace: no network device at all
  /// parent_death_signal  killed when the thread ends that started it
  /// capabilities         none, and none to be had: bounding set, permitted, ambient
  /// no_new_privs         no program gives any
  /// landlock             no path can be opened, no TCP port, no abstract socket
  /// rlimits              address space, CPU, file size, 16 descriptors, no process, no core dump
  /// seccomp              an allowlist of system calls, without any that starts a process or a
  ///                      thread; others answer EPERM, opening ENOENT
  [[nodiscard]] SandboxReport enter(const std::function<void()>& start_threads = [] {}) const;

 private:
  explicit Sandbox(const SandboxLimits& limits, void* filter) : limits_(limits), filter_(filter) {}
  SandboxLimits limits_;
  void* filter_;
};

}  // namespace heliograph::server
