// Config to the parts of the daemon. Called by main.
#include "server/daemon.h"

#include <sys/random.h>

#include <algorithm>
#include <thread>

namespace heliograph::server {
namespace {

u64 random_number() {
  u64 number = 0;
  [[maybe_unused]] const auto size = ::getrandom(&number, sizeof number, 0);
  return number;
}

ReplyLimits reply_limits(const Limits& limits) { return {limits.replies, limits.reply_bytes}; }

Scenes::Options scene_options(const Limits& limits) {
  return {.limit = u32(limits.scenes),
          .scene = {.entities = u32(limits.entities),
                    .array_bytes = limits.array_bytes,
                    .revisions = u32(limits.revisions)},
          .replies = reply_limits(limits),
          .queue = u32(limits.calls_per_session)};
}

Sessions::Options session_options(const Config& config) {
  return {.limit = u32(config.limits.sessions),
          .grace_seconds = config.grace_seconds,
          .session = {.calls = u32(config.limits.calls_per_session),
                      .shared_bytes = config.limits.shared_bytes,
                      .replies = reply_limits(config.limits)}};
}

}  // namespace

Daemon::Daemon(Config settings, Identities identities, std::unique_ptr<EventLoop> event_loop)
    : config(std::move(settings)),
      instance(random_number()),
      log(config.log_level, config.log_json),
      loop(std::move(event_loop)),
      pool(std::clamp(std::thread::hardware_concurrency(), 2u, 16u), u32(config.limits.pool_queue)),
      scenes(pool, scene_options(config.limits)),
      tenants(config.limits, std::move(identities)),
      sessions(*loop, session_options(config),
               [this](const Session& session) {
                 log.info("session ended",
                          {{"client", session.client()}, {"tenant", session.tenant()->name}});
                 scenes.end_session(session.id());
               }),
      gate(tenants, sessions),
      health(*loop, log,
             {.hang_seconds = double(config.limits.hang_seconds),
              .probe_seconds = double(config.limits.probe_seconds)}) {}

}  // namespace heliograph::server
