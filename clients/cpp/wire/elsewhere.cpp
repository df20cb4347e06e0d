// Refusals of what only Linux has: Unix sockets with tickets, and private daemons.
#include "heliograph/error.h"
#include "wire/launch.h"
#include "wire/local_channel.h"

namespace heliograph::client::wire {
namespace {

[[noreturn]] void refuse() {
  throw ClientError(Code::kUnimplemented,
                    "Unix sockets and private daemons are for Linux; connect to \"host:port\" with "
                    "the daemon's token");
}

}  // namespace

LocalChannel::LocalChannel(const std::string&, double) { refuse(); }
LocalChannel::~LocalChannel() = default;

struct PrivateDaemon::Process {};
PrivateDaemon::PrivateDaemon(const LaunchOptions&) { refuse(); }
PrivateDaemon::~PrivateDaemon() = default;
const std::string& PrivateDaemon::address() const { refuse(); }
bool PrivateDaemon::is_dead() { refuse(); }
ClientError PrivateDaemon::death(const std::string&, double) { refuse(); }
void PrivateDaemon::stop() {}

}  // namespace heliograph::client::wire
