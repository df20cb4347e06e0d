// heliographd: flags in, exit status out.
#include <csignal>
#include <cstdlib>

#include "server/app/large_pages.h"
#include "server/app/lifecycle.h"
#include "server/app/probe.h"

int main(int argc, char** argv) {
  using namespace heliograph::server;
  std::signal(SIGPIPE, SIG_IGN);
  auto config = parse_config(argc, argv);
  if (!config) return config.error();
  if (!config->probe.empty()) return probe(*config);
  use_large_pages();
  std::_Exit(run(std::move(*config)));  // threads of gRPC may still run, see grpc_server.cpp
}
