// Requests to jobs. See render_task.h.
#include "server/calls/render_task.h"

#include <fmt/format.h>

#include "server/config/version.h"
#include "server/convert/fields.h"
#include "server/convert/frame.h"
#include "server/convert/limits.h"
#include "server/convert/render.h"
#include "server/convert/worlds.h"

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
  HELIO_CHECK(check_count(overlay, daemon.config.limits.edits), "overlay");
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
  if (job.worlds) bytes *= job.worlds->rendered.size();
  if (bytes <= limit) return {};
  Error error{
      .code = Code::kResourceExhausted,
      .message = fmt::format("the frames would take {} bytes, {} are allowed; ask for fewer "
                             "worlds, cameras, planes or pixels (limit frame_bytes)",
                             bytes, limit),
      .where = "planes"};
  error.limit = "frame_bytes";
  error.needed = bytes;
  error.available = limit;
  return std::unexpected(std::move(error));
}

Expected<std::shared_ptr<RenderJob>> make_job(Daemon& daemon, Session& session,
                                              const v1::RenderRequest& request) {
  const auto entry = daemon.scenes.find(request.scene(), session);
  if (!entry) return std::unexpected(entry.error());
  auto snapshot = base_of(**entry, request);
  if (snapshot && request.has_overlay())
    snapshot = with_overlay(daemon, session, *snapshot, request.overlay());
  if (!snapshot) return std::unexpected(snapshot.error());
  const Limits& limits = daemon.config.limits;
  auto job = to_job(request, std::move(*snapshot),
                    {.spp = u32(limits.samples), .groups = u32(limits.groups)});
  if (!job) return std::unexpected(job.error());
  if (request.has_worlds()) {
    auto worlds = to_worlds(request.worlds(), *job->snapshot, session.holdings(),
                            {.worlds = limits.worlds, .edits = limits.edits});
    if (!worlds) return std::unexpected(std::move(worlds).error().at("worlds"));
    worlds->limits = daemon.scenes.scene_limits();
    job->worlds = std::make_shared<const Worlds>(*std::move(worlds));
  }
  HELIO_TRY(check_size(*job, limits.frame_bytes));
  job->origin = session.tenant()->origin(session.id(), job->origin.priority);
  return std::make_shared<RenderJob>(std::move(*job));
}

/// Counts a job while it waits and runs, and charges what it took.
class Metered final : public JobSink {
 public:
  Metered(std::shared_ptr<JobSink> sink, Metrics& metrics, TenantPtr tenant, Charge running)
      : sink_(std::move(sink)),
        metrics_(metrics),
        tenant_(std::move(tenant)),
        running_(std::move(running)) {}
  void progress(const Progress& progress) override { sink_->progress(progress); }
  void frame(std::shared_ptr<const Frame> frame) override { sink_->frame(std::move(frame)); }
  void done(Status status, const Spent& spent) override {
    tenant_->samples.charge(spent.samples);
    metrics_.job(tenant_->name, status, spent);
    [[maybe_unused]] const auto given_back = running_.resize(0);
    sink_->done(std::move(status), spent);
  }

 private:
  std::shared_ptr<JobSink> sink_;
  Metrics& metrics_;
  TenantPtr tenant_;
  Charge running_;
};

}  // namespace

Expected<RenderTask> to_task(Daemon& daemon, Session& session, const v1::RenderRequest& request) {
  auto job = make_job(daemon, session, request);
  if (!job) return std::unexpected(job.error());
  auto engine = daemon.engine->wait();
  if (!engine) return std::unexpected(engine.error());
  FrameContext context{.request = request,
                       .job = *job,
                       .version = kVersion,
                       .backend = std::string((*engine)->backend_name()),
                       .cpu_features = (*engine)->cpu_features()};
  return RenderTask{*std::move(job), std::make_shared<FrameHeaders>(std::move(context)), *engine,
                    session.tenant()};
}

FrameCutter::Begun note_frames(const Daemon& daemon, const grpc::ServerContextBase& context) {
  if (!daemon.recorder) return {};
  return [recorder = daemon.recorder.get(), &context](const std::shared_ptr<const Frame>& frame) {
    recorder->frame(&context, frame);
  };
}

Status submit(Daemon& daemon, const RenderTask& task, std::shared_ptr<JobSink> sink,
              std::stop_token stop) {
  HELIO_TRY(check_queue(*task.engine, daemon.config.limits.jobs));
  HELIO_TRY(task.tenant->samples.admit());
  auto running = Charge::take(task.tenant->jobs, 1);
  if (!running) {
    running.error().retry_seconds = retry_seconds(*task.engine);
    return std::unexpected(std::move(running).error());
  }
  auto metered =
      std::make_shared<Metered>(std::move(sink), daemon.metrics, task.tenant, std::move(*running));
  HELIO_TRY(task.engine->submit(task.job, std::move(metered), std::move(stop)));
  task.headers->write_ahead();
  return {};
}

}  // namespace heliograph::server
