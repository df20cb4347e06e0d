// Runs a program under a filter of system calls, as systemd and container engines make them: what
// is refused answers EPERM. Used by test_sandbox.py.
//
// usage: syscall-filter allow FILE PROGRAM...    only those that FILE names, one in a line
//        syscall-filter deny NAME... -- PROGRAM...  prlimit64: only where it sets a limit
#include <seccomp.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <string>
#include <string_view>

namespace {

/// Names of other architectures are passed over, as systemd does.
int allow(scmp_filter_ctx filter, const char* path) {
  std::ifstream file(path);
  int worst = file ? 0 : -ENOENT;
  for (std::string name; std::getline(file, name);) {
    const int call = seccomp_syscall_resolve_name(name.c_str());
    if (call < 0) continue;
    const int code = seccomp_rule_add(filter, SCMP_ACT_ALLOW, call, 0);
    worst = worst ? worst : code;
  }
  return worst;
}

int deny(scmp_filter_ctx filter, std::string_view name) {
  const int call = seccomp_syscall_resolve_name(name.data());
  if (call < 0) return -EINVAL;
  const scmp_arg_cmp sets_a_limit{2, SCMP_CMP_NE, 0, 0};
  const unsigned conditions = name == "prlimit64" ? 1 : 0;
  return seccomp_rule_add_array(filter, SCMP_ACT_ERRNO(EPERM), call, conditions, &sets_a_limit);
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 4) return 64;
  const bool is_allow = arguments[1] == std::string_view("allow");
  scmp_filter_ctx filter = seccomp_init(is_allow ? SCMP_ACT_ERRNO(EPERM) : SCMP_ACT_ALLOW);
  int next = 2;
  int worst = 0;
  if (is_allow) {
    worst = allow(filter, arguments[next++]);
  } else {
    for (; next < count && arguments[next] != std::string_view("--"); ++next) {
      const int code = deny(filter, arguments[next]);
      worst = worst ? worst : code;
    }
    ++next;
  }
  if (worst == 0) worst = seccomp_load(filter);
  if (worst != 0 || next >= count) {
    std::fprintf(stderr, "syscall-filter: no filter: %d\n", worst);
    return 70;
  }
  execv(arguments[next], arguments + next);
  std::perror(arguments[next]);
  return 70;
}
