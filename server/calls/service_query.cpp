// Query and Tracks: spatial questions, answered by the device between jobs.
#include "server/calls/render_task.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/query.h"
#include "server/convert/table_rows.h"
#include "server/convert/tracks.h"
#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

constexpr u64 kAnswerBytes = 128;  // per item, in the reply and before

template <class Reply>
void send(PullStream<Reply>& call, QueryResult result, Revision revision) {
  const auto rows = std::make_shared<TableRows>(std::move(result));
  call.pull([rows, revision](Reply& reply) -> Expected<bool> {
    reply.set_revision(revision);
    return rows->next(*reply.mutable_columns());
  });
}

/// Checks a request with `to_job(snapshot, arrays)`, runs it on the device, and sends the answer.
template <class Request, class Reply, class ToJob>
void start_query(Daemon& daemon, PullStream<Reply>& call, const Request& request,
                 const ToJob& to_job) {
  Session& session = *call.session();
  const auto entry = daemon.scenes.find(request.scene(), session);
  if (!entry) return call.finish(std::unexpected(entry.error()));
  const auto snapshot = snapshot_at(
      **entry, request.has_revision() ? std::optional(request.revision()) : std::nullopt);
  if (!snapshot) return call.finish(std::unexpected(snapshot.error()));
  daemon.note_revision(call.context(), (*snapshot)->revision);
  auto job = to_job(*snapshot, session.arrays());
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
      [&call, counted = std::make_shared<Charge>(std::move(*counted)),
       revision = (*snapshot)->revision](Expected<QueryResult>&& result) {
        if (!result) return call.finish(std::unexpected(std::move(result).error()));
        send(call, *std::move(result), revision);
      },
      call.stop());
}

/// Admits a query and runs it from the pool.
template <class Reply, class Request, class ToJob>
Writer<Reply>* ask(Daemon& daemon, Context* context, const Request& request, ToJob to_job) {
  return let_in<Writer<Reply>>(daemon.gate, context, request, Needs::kSession, [&](Call admitted) {
    auto* call = PullStream<Reply>::make(daemon, *context, std::move(admitted));
    const auto posted = daemon.pool.post(call->tenant()->id, [&daemon, call, &request, to_job] {
      start_query(daemon, *call, request, to_job);
    });
    if (!posted) call->finish(posted);
    return call;
  });
}

}  // namespace

Writer<v1::QueryReply>* Service::Query(Context* context, const v1::QueryRequest* request) {
  const QueryLimits limits{.items = daemon_.config.limits.query_items};
  return ask<v1::QueryReply>(
      daemon_, context, *request,
      [request, limits](std::shared_ptr<const Snapshot> snapshot, ArraySource& source) {
        return to_query(*request, std::move(snapshot), source, limits);
      });
}

Writer<v1::TracksReply>* Service::Tracks(Context* context, const v1::TracksRequest* request) {
  const TrackLimits limits{.items = daemon_.config.limits.query_items,
                           .times = daemon_.config.limits.track_times};
  return ask<v1::TracksReply>(
      daemon_, context, *request,
      [request, limits](std::shared_ptr<const Snapshot> snapshot, ArraySource& source) {
        return to_tracks(*request, std::move(snapshot), source, limits);
      });
}

}  // namespace heliograph::server
