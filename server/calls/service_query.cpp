// Query and Tracks: spatial questions, answered by the device between jobs.
#include "server/calls/render_task.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/query.h"
#include "server/convert/tracks.h"
#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

constexpr u64 kAnswerBytes = 128;  // of one item, in the reply and before

/// What a question is charged as, in samples.
u64 items_of(const QueryJob& job) {
  struct Count {
    u64 operator()(const CastRays& q) const { return q.origins.size(); }
    u64 operator()(const Pick& q) const { return q.pixels.size(); }
    u64 operator()(const Visible& q) const { return q.entities.size(); }
    u64 operator()(const Overlaps& q) const { return q.a.size(); }
    u64 operator()(const SampleSurface& q) const { return q.entities.size() * q.count; }
    u64 operator()(const Tracks& q) const { return q.points.size() * q.times.size(); }
  };
  return std::visit(Count(), job.query);
}

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
  auto counted = count_job(**engine, *call.tenant());
  if (!counted) return call.finish(std::unexpected(std::move(counted).error()));
  auto answer = Charge::take(call.tenant()->ledger.bytes, charged(kAnswerBytes * items_of(*job)));
  if (!answer) return call.finish(std::unexpected(std::move(answer).error()));
  call.hold(std::move(*answer));
  call.tenant()->samples.charge(items_of(*job));
  (*engine)->submit(
      std::make_shared<const QueryJob>(std::move(*job)),
      [&call, &reply, to_reply, counted = std::make_shared<Charge>(std::move(*counted)),
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
