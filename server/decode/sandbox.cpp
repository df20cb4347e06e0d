#include "server/decode/sandbox.h"

#include <fcntl.h>
#include <linux/capability.h>
#include <sched.h>
#include <seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <utility>

#include "server/decode/wire.h"

namespace heliograph::server {
namespace {

// System calls that the decoders, malloc and existing threads need. Source: docs/decisions/008.
constexpr std::array kAllowed = {SCMP_SYS(read),
                                 SCMP_SYS(write),
                                 SCMP_SYS(pread64),
                                 SCMP_SYS(pwrite64),
                                 SCMP_SYS(lseek),
                                 SCMP_SYS(fstat),
                                 SCMP_SYS(close),
                                 SCMP_SYS(mremap),
                                 SCMP_SYS(munmap),
                                 SCMP_SYS(brk),
                                 SCMP_SYS(madvise),
                                 SCMP_SYS(futex),
                                 SCMP_SYS(rt_sigreturn),
                                 SCMP_SYS(rt_sigprocmask),
                                 SCMP_SYS(sigaltstack),
                                 SCMP_SYS(exit),
                                 SCMP_SYS(exit_group),
                                 SCMP_SYS(clock_gettime),
                                 SCMP_SYS(clock_nanosleep),
                                 SCMP_SYS(gettid),
                                 SCMP_SYS(getpid),
                                 SCMP_SYS(sched_yield),
                                 SCMP_SYS(sched_getaffinity),
                                 SCMP_SYS(set_robust_list),
                                 SCMP_SYS(rseq),
                                 SCMP_SYS(getrandom),
                                 SCMP_SYS(ftruncate),
                                 SCMP_SYS(sendmsg),
                                 SCMP_SYS(sysinfo),
                                 SCMP_SYS(restart_syscall)};
constexpr std::array kNoSuchFile = {SCMP_SYS(open),     SCMP_SYS(openat),     SCMP_SYS(openat2),
                                    SCMP_SYS(readlink), SCMP_SYS(readlinkat), SCMP_SYS(newfstatat),
                                    SCMP_SYS(access)};

/// Adds all rules; 0: success.
int add_rules(scmp_filter_ctx filter) {
  int worst = seccomp_attr_set(filter, SCMP_FLTATR_CTL_TSYNC, 1);
  (void)seccomp_attr_set(filter, SCMP_FLTATR_API_SYSRAWRC, 1);  // errors are the kernel's own errno
  const auto add = [&](u32 action, int call, auto... conditions) {
    const scmp_arg_cmp list[] = {conditions..., scmp_arg_cmp{}};
    const int code = seccomp_rule_add_array(filter, action, call, sizeof...(conditions), list);
    worst = worst ? worst : code;
  };
  for (const int call : kAllowed) add(SCMP_ACT_ALLOW, call);
  for (const int call : kNoSuchFile) add(SCMP_ACT_ERRNO(ENOENT), call);
  const auto masked = [](u32 argument, u64 mask, u64 value) {
    return scmp_arg_cmp{argument, SCMP_CMP_MASKED_EQ, mask, value};
  };
  add(SCMP_ACT_ALLOW, SCMP_SYS(mmap), masked(2, PROT_EXEC, 0));
  add(SCMP_ACT_ALLOW, SCMP_SYS(mprotect), masked(2, PROT_EXEC, 0));
  for (const u64 command : {F_GET_SEALS, F_GETFL})
    add(SCMP_ACT_ALLOW, SCMP_SYS(fcntl), scmp_arg_cmp{1, SCMP_CMP_EQ, command, 0});
  return worst;
}

bool limit(int resource, rlim_t value) {
  const rlimit both{value, value};
  return setrlimit(resource, &both) == 0;
}

bool enter_rlimits(const SandboxLimits& limits) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  const bool memory = true;  // the sanitizer's shadow memory exceeds any limit
#else
  const bool memory = limit(RLIMIT_AS, limits.memory_bytes);
#endif
  // The hard limit, a second later, kills without a name: SIGXCPU comes first.
  const rlimit cpu{limits.cpu_seconds, limits.cpu_seconds + 1};
  const rlimit file{0, limits.file_bytes};  // the parent raises it
  return memory && setrlimit(RLIMIT_CPU, &cpu) == 0 && setrlimit(RLIMIT_FSIZE, &file) == 0 &&
         limit(RLIMIT_NOFILE, 16) && limit(RLIMIT_NPROC, 0) && limit(RLIMIT_CORE, 0);
}

/// Drops all capabilities, which a user namespace begins with. A process that may not shrink the
/// bounding set has none.
bool drop_capabilities() {
  constexpr unsigned long kMost = 64;
  for (unsigned long capability = 0; capability < kMost; ++capability)
    (void)prctl(PR_CAPBSET_DROP, capability, 0, 0, 0);
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  const __user_cap_data_struct none[_LINUX_CAPABILITY_U32S_3]{};
  return syscall(SYS_capset, &header, none) == 0;
}

/// Source: Landlock user-space API of the Linux kernel, ABI 1 to 6. An empty ruleset that handles
/// every right denies it everywhere.
bool enter_landlock() {
  constexpr long kCreateRuleset = 444;
  constexpr long kRestrictSelf = 446;
  constexpr u32 kVersion = 1;
  const long abi = syscall(kCreateRuleset, nullptr, 0, kVersion);
  if (abi < 1) return false;
  const int rights = abi >= 5 ? 16 : abi >= 3 ? 15 : abi == 2 ? 14 : 13;
  struct {
    u64 fs, net, scoped;
  } ruleset{(1ull << rights) - 1, abi >= 4 ? 3ull : 0, abi >= 6 ? 3ull : 0};
  const Fd fd(int(syscall(kCreateRuleset, &ruleset, sizeof ruleset, 0)));
  return fd && syscall(kRestrictSelf, fd.get(), 0) == 0;
}

/// User namespaces are unavailable in a chroot; a privileged process needs none for the other
/// namespaces.
bool enter_namespaces() {
  constexpr int kOthers = CLONE_NEWNET | CLONE_NEWNS | CLONE_NEWIPC;
  return unshare(CLONE_NEWUSER | kOthers) == 0 || unshare(kOthers) == 0;
}

}  // namespace

Expected<Sandbox> Sandbox::prepare(const SandboxLimits& limits) {
  scmp_filter_ctx filter = seccomp_init(SCMP_ACT_ERRNO(EPERM));
  if (!filter) return fail(Code::kInternal, "", "seccomp: no memory");
  Sandbox sandbox(limits, filter);
  const int code = add_rules(filter);
  if (code == 0) return sandbox;
  errno = -code;
  return fail(Code::kInternal, "", system_message("seccomp"));
}

Sandbox::Sandbox(Sandbox&& other) noexcept
    : limits_(other.limits_), filter_(std::exchange(other.filter_, nullptr)) {}

Sandbox::~Sandbox() {
  if (filter_) seccomp_release(filter_);
}

SandboxReport Sandbox::enter(const std::function<void()>& start_threads) const {
  SandboxReport report;
  const auto note = [&](const char* layer, bool held) {
    if (held) {
      report.active.emplace_back(layer);
    } else {
      report.refused.push_back(system_message(layer));
    }
  };
  note("namespaces", enter_namespaces());
  // After unshare: new credentials clear it.
  note("parent_death_signal", prctl(PR_SET_PDEATHSIG, SIGKILL) == 0);
  note("capabilities", drop_capabilities());
  note("no_new_privs", prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0);
  note("landlock", enter_landlock());
  start_threads();  // they inherit the layers in force
  note("rlimits", enter_rlimits(limits_));
  const int code = seccomp_load(filter_);
  errno = -code;
  note("seccomp", code == 0);
  return report;
}

}  // namespace heliograph::server
