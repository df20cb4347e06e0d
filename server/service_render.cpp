// Render: resolves the revision, applies the overlay, submits the job, streams the frames.
#include "server/convert/frame.h"
#include "server/convert/render.h"
#include "server/frame_stream.h"
#include "server/rpc.h"
#include "server/service.h"
#include "server/version.h"

namespace heliograph::server {
namespace {

using SnapshotPtr = std::shared_ptr<const Snapshot>;

Expected<SnapshotPtr> base_of(const SceneEntry& entry, const v1::RenderRequest& request) {
  if (request.has_revision()) return entry.scene.at(request.revision());
  auto head = entry.scene.head();
  if (head->revision >= request.min_revision()) return head;
  Error error{.code = Code::kOutOfRange,
              .message = fmt::format("the scene is at revision {}, which is below {}; wait for the "
                                     "edit's reply before asking for its revision",
                                     head->revision, request.min_revision()),
              .where = "min_revision"};
  error.expected = head->revision;
  return std::unexpected(std::move(error));
}

/// The overlay on a snapshot of its own, under the revision it is based on.
Expected<SnapshotPtr> with_overlay(Daemon& daemon, Session& session, const SnapshotPtr& base,
                                   const v1::Transaction& overlay) {
  const auto transaction = to_transaction(overlay, session.holdings());
  if (!transaction) return std::unexpected(Error(transaction.error()).at("overlay"));
  const auto prepared = apply(*base, *transaction, daemon.scenes.scene_limits());
  if (!prepared) return std::unexpected(Error(prepared.error()).at("overlay"));
  auto snapshot = std::make_shared<Snapshot>(*prepared->snapshot);
  snapshot->revision = base->revision;
  return snapshot;
}

/// RESOURCE_EXHAUSTED when the frames of all cameras would take too many bytes.
Status check_size(const RenderJob& job, u64 limit) {
  u64 pixel = 0;
  for (const Plane plane : job.planes)
    pixel += size_of(plane_info(plane).dtype) * plane_info(plane).channels;
  u64 bytes = 0;
  for (const EntityId id : job.cameras) {
    const Camera& camera = *job.snapshot->find(id)->camera;
    bytes += pixel * (job.width != 0 ? job.width : camera.width) *
             (job.height != 0 ? job.height : camera.height);
  }
  if (bytes <= limit) return {};
  Error error{
      .code = Code::kResourceExhausted,
      .message = fmt::format("the frames would take {} bytes, {} are allowed; ask for fewer "
                             "cameras, planes or pixels (limit frame_bytes)",
                             bytes, limit),
      .where = "planes"};
  error.needed = bytes;
  error.available = limit;
  return std::unexpected(std::move(error));
}

Expected<std::shared_ptr<RenderJob>> make_job(Daemon& daemon, Session& session,
                                              const v1::RenderRequest& request) {
  const auto entry = daemon.scenes.find(request.scene(), session.id());
  if (!entry) return std::unexpected(entry.error());
  auto snapshot = base_of(**entry, request);
  if (snapshot && request.has_overlay())
    snapshot = with_overlay(daemon, session, *snapshot, request.overlay());
  if (!snapshot) return std::unexpected(snapshot.error());
  const Limits& limits = daemon.config.limits;
  auto job = to_job(request, std::move(*snapshot),
                    {.spp = u32(limits.samples), .groups = u32(limits.groups)});
  if (!job) return std::unexpected(job.error());
  HELIO_TRY(check_size(*job, limits.frame_bytes));
  return std::make_shared<RenderJob>(std::move(*job));
}

Status start_render(Daemon& daemon, const v1::RenderRequest& request,
                    const std::shared_ptr<FrameStream>& stream) {
  auto job = make_job(daemon, *stream->session(), request);
  if (!job) return std::unexpected(job.error());
  (*job)->deadline = stream->deadline();
  auto engine = daemon.engine->wait();
  if (!engine) return std::unexpected(engine.error());
  HELIO_TRY(check_queue(**engine, daemon.config.limits.jobs));
  stream->set_header([context = FrameContext{.request = request,
                                             .job = *job,
                                             .version = kVersion,
                                             .backend = std::string((*engine)->backend_name()),
                                             .cpu_features = (*engine)->cpu_features()}](
                         const Frame& frame) { return to_header(frame, context); });
  return (*engine)->submit(*job, stream, stream->stop());
}

}  // namespace

Writer<v1::FramePart>* Service::Render(Context* context, const v1::RenderRequest* request) {
  using Refused = Refusal<Writer<v1::FramePart>>;
  auto admitted = daemon_.gate.admit(*context, Needs::kSession);
  if (!admitted) return new Refused(*context, admitted.error());
  auto stream = FrameStream::start(*context, std::move(*admitted), daemon_.config.limits);
  auto task = [this, request, stream] {
    if (stream->stop().stop_requested())
      return stream->done(fail(Code::kCancelled, "", "cancelled"));
    if (auto started = start_render(daemon_, *request, stream); !started) stream->done(started);
  };
  if (auto posted = daemon_.pool.post(std::move(task)); !posted) stream->done(posted);
  return stream.get();
}

}  // namespace heliograph::server
