#include "server/app/signals.h"

#include <sys/signalfd.h>
#include <unistd.h>

#include <csignal>

#include "server/config/config.h"

namespace heliograph::server {
namespace {

constexpr unsigned kHurriedSeconds = 1;

sigset_t ending_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  return set;
}

}  // namespace

UniqueFd block_signals() {
  const sigset_t set = ending_signals();
  ::sigprocmask(SIG_BLOCK, &set, nullptr);
  return UniqueFd(::signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK));
}

void hurry() {
  std::signal(SIGALRM, [](int) { ::_exit(kExitOk); });
  ::alarm(kHurriedSeconds);
}

void hurry_at_signal() {
  for (const int signal : {SIGTERM, SIGINT}) std::signal(signal, [](int) { hurry(); });
  const sigset_t set = ending_signals();
  ::pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
}

}  // namespace heliograph::server
