// Query and Tracks: spatial questions, answered by the device between jobs.
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/query.h"
#include "server/convert/tracks.h"

namespace heliograph::server {
namespace {

/// Checks a request with `to_job(snapshot, holdings)`, has the device answer it, and makes the
/// reply with `to_reply(result, revision)`.
template <class Request, class Reply, class ToJob, class ToReply>
void start_query(Daemon& daemon, UnaryCall& call, const Request& request, Reply& reply,
                 const ToJob& to_job, ToReply to_reply) {
  Session& session = *call.session();
  const auto entry = daemon.scenes.find(request.scene(), session);
  if (!entry) return call.finish(std::unexpected(entry.error()));
  const auto snapshot = snapshot_at(
      **entry, request.has_revision() ? std::optional(request.revision()) : std::nullopt);
  if (!snapshot) return call.finish(std::unexpected(snapshot.error()));
  daemon.note_revision(call.context(), (*snapshot)->revision);
  auto job = to_job(*snapshot, session.holdings());
  if (!job) return call.finish(std::unexpected(job.error()));
  job->origin = session.tenant()->origin(session.id(), request.scene());
  const auto engine = daemon.engine->wait();
  if (!engine) return call.finish(std::unexpected(engine.error()));
  if (auto room = check_queue(**engine, daemon.config.limits.jobs); !room) return call.finish(room);
  (*engine)->submit(
      std::make_shared<const QueryJob>(std::move(*job)),
      [&call, &reply, to_reply,
       revision = (*snapshot)->revision](const Expected<QueryResult>& result) {
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
    call.post(daemon_.pool, [this, request, reply, &call] {
      const QueryLimits limits{.items = daemon_.config.limits.query_items};
      const auto to_job = [&](std::shared_ptr<const Snapshot> snapshot, ArraySource& source) {
        return to_query(*request, std::move(snapshot), source, limits);
      };
      start_query(daemon_, call, *request, *reply, to_job, to_reply);
    });
  });
}

grpc::ServerUnaryReactor* Service::Tracks(Context* context, const v1::TracksRequest* request,
                                          v1::TracksReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    call.post(daemon_.pool, [this, request, reply, &call] {
      const TrackLimits limits{.items = daemon_.config.limits.query_items,
                               .times = daemon_.config.limits.track_times};
      const auto to_job = [&](std::shared_ptr<const Snapshot> snapshot, ArraySource& source) {
        return to_tracks(*request, std::move(snapshot), source, limits);
      };
      start_query(daemon_, call, *request, *reply, to_job, to_tracks_reply);
    });
  });
}

}  // namespace heliograph::server
