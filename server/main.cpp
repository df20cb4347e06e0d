// heliographd: flags in, exit status out.
#include <csignal>

#include "server/lifecycle.h"

int main(int argc, char** argv) {
  using namespace heliograph::server;
  std::signal(SIGPIPE, SIG_IGN);
  auto config = parse_config(argc, argv);
  return config ? run(std::move(*config)) : config.error();
}
