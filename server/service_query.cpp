// Query: spatial questions, answered by the device between jobs.
#include "server/convert/query.h"
#include "server/rpc.h"
#include "server/service.h"

namespace heliograph::server {
namespace {

void start_query(Daemon& daemon, UnaryCall& call, const v1::QueryRequest& request,
                 v1::QueryReply& reply) {
  Session& session = *call.session();
  const auto entry = daemon.scenes.find(request.scene(), session.id());
  if (!entry) return call.finish(std::unexpected(entry.error()));
  const auto snapshot = snapshot_at(
      **entry, request.has_revision() ? std::optional(request.revision()) : std::nullopt);
  if (!snapshot) return call.finish(std::unexpected(snapshot.error()));
  auto job =
      to_query(request, *snapshot, session.holdings(), {.items = daemon.config.limits.query_items});
  if (!job) return call.finish(std::unexpected(job.error()));
  const auto engine = daemon.engine->wait();
  if (!engine) return call.finish(std::unexpected(engine.error()));
  if (auto room = check_queue(**engine, daemon.config.limits.jobs); !room) return call.finish(room);
  (*engine)->submit(
      std::make_shared<const QueryJob>(std::move(*job)),
      [&call, &reply, revision = (*snapshot)->revision](const Expected<QueryResult>& result) {
        if (!result) return call.finish(std::unexpected(result.error()));
        reply = to_reply(*result, revision);
        call.finish({});
      },
      call.stop());
}

}  // namespace

grpc::ServerUnaryReactor* Service::Query(Context* context, const v1::QueryRequest* request,
                                         v1::QueryReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    call.post(daemon_.pool,
              [this, request, reply, &call] { start_query(daemon_, call, *request, *reply); });
  });
}

}  // namespace heliograph::server
