// Converts requests to jobs. See render_task.h.
#include "server/calls/render_task.h"

#include <fmt/format.h>

#include "server/config/version.h"
#include "server/convert/fields.h"
#include "server/convert/frame.h"
#include "server/convert/limits.h"
#include "server/convert/render.h"
#include "server/convert/worlds.h"
#include "server/quota/credits.h"
#include "server/store/used_uploads.h"

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

/// Applies the overlay to a snapshot of its own, under the number of its base revision.
Expected<SnapshotPtr> with_overlay(Daemon& daemon, Session& session, const SnapshotPtr& base,
                                   const v1::Transaction& overlay) {
  HELIO_CHECK(check_count(overlay, daemon.config.limits.edits), "overlay");
  UsedUploads source(session.arrays());
  const auto transaction = to_transaction(overlay, source);
  if (!transaction) {
    source.give_back(transaction.error());
    return std::unexpected(Error(transaction.error()).at("overlay"));
  }
  const auto prepared = apply(*base, *transaction, daemon.scenes.scene_limits());
  if (!prepared) return std::unexpected(Error(prepared.error()).at("overlay"));
  auto snapshot = std::make_shared<Snapshot>(*prepared->snapshot);
  snapshot->revision = base->revision;
  return snapshot;
}

/// Returns the bytes of the frames of all cameras and worlds.
u64 frame_bytes_of(const RenderJob& job) {
  u64 pixel = 0;
  for (const Plane plane : job.planes)
    pixel += size_of(plane_info(plane).dtype) * plane_info(plane).channels;
  u64 bytes = 0;
  for (const EntityId id : job.cameras) {
    const Camera& camera = *job.snapshot->find(id)->camera;
    bytes += pixel * (job.width != 0 ? job.width : camera.width) *
             (job.height != 0 ? job.height : camera.height);
  }
  return job.worlds ? bytes * job.worlds->rendered.size() : bytes;
}

Status check_size(u64 bytes, u64 limit) {
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
    UsedUploads source(session.arrays());
    auto worlds = to_worlds(request.worlds(), *job->snapshot, source,
                            {.worlds = limits.worlds, .edits = limits.edits});
    if (!worlds) {
      source.give_back(worlds.error());
      return std::unexpected(std::move(worlds).error().at("worlds"));
    }
    worlds->limits = daemon.scenes.scene_limits();
    job->worlds = std::make_shared<const Worlds>(*std::move(worlds));
  }
  HELIO_TRY(check_size(frame_bytes_of(*job), limits.frame_bytes));
  job->origin = session.tenant()->origin(session.id(), job->scene, job->origin.priority);
  return std::make_shared<RenderJob>(std::move(*job));
}

/// Returns the bytes of planes on the heap; leases are charged by SharedFrames.
u64 heap_bytes(const Frame& frame) {
  u64 bytes = 0;
  for (const PlaneData& plane : frame.planes)
    if (dynamic_cast<LeasedPixels*>(plane.pixels.memory()) == nullptr) bytes += plane.pixels.size();
  return bytes;
}

/// Charges the frames of a job that are not leased. Refuses a job with leases whose tenant exceeds
/// its limit: leases failed, and frames went to the heap.
Expected<Charge> frame_room(const RenderTask& task) {
  const Budget& bytes = *task.tenant->ledger.bytes;
  const bool is_leased = task.job->memory && bytes.used() <= bytes.limit();
  auto room = Charge::take(task.tenant->ledger.bytes, is_leased ? 0 : charged(task.frame_bytes));
  if (room) return room;
  Error error = std::move(room).error().at("planes");
  if (task.tenant->ledger.jobs->used() > 1) error.retry_seconds = retry_seconds(*task.engine);
  return std::unexpected(std::move(error));
}

/// Decorates a sink: counts the job while it waits and runs, charges its frames until they are sent
/// and its cost at the end, and records it in its call.
class Metered final : public JobSink {
 public:
  struct Charges {
    Charge running;
    Charge request;
    Charge frames;  // charge of frames still to come
  };
  Metered(std::shared_ptr<JobSink> sink, Daemon& daemon, const RenderTask& task, Charges charges)
      : sink_(std::move(sink)),
        daemon_(daemon),
        tenant_(task.tenant),
        call_(task.call),
        charges_(std::move(charges)) {
    call_->begin_job();
  }
  void progress(const Progress& progress) override { sink_->progress(progress); }
  void frame(std::shared_ptr<const Frame> frame) override {
    sink_->frame(counted(std::move(frame)));
  }
  void done(Status status, const Spent& spent) override {
    tenant_->samples.charge(spent.samples);
    daemon_.metrics.job(tenant_->name, status, spent);
    call_->end_job(spent);
    const std::chrono::duration<double> took = CallClock::now() - queued_;
    daemon_.call_log.end_job(*call_, took.count(), spent);
    charges_ = {};
    sink_->done(std::move(status), spent);
  }

 private:
  /// Charges a frame for as long as it is referenced: from the job's reserve, and beyond that (a
  /// frame per step) regardless of the limit.
  std::shared_ptr<const Frame> counted(std::shared_ptr<const Frame> frame) {
    struct Counted {
      std::shared_ptr<const Frame> frame;
      Charge charge;
    };
    const u64 bytes = charged(heap_bytes(*frame));
    if (bytes == 0) return frame;
    Charge charge = charges_.frames.split(bytes);
    if (const u64 set_aside = charge.amount(); set_aside < bytes)
      charge.merge(Charge::count(tenant_->ledger.bytes, bytes - set_aside));
    const auto held = std::make_shared<const Counted>(std::move(frame), std::move(charge));
    return {held, held->frame.get()};
  }

  std::shared_ptr<JobSink> sink_;
  Daemon& daemon_;
  TenantPtr tenant_;
  CallRecordPtr call_;
  const CallClock::time_point queued_ = CallClock::now();
  Charges charges_;
};

}  // namespace

Expected<RenderTask> to_task(Daemon& daemon, Session& session, const v1::RenderRequest& request,
                             CallRecordPtr call) {
  auto job = make_job(daemon, session, request);
  if (!job) return std::unexpected(job.error());
  auto engine = daemon.engine->wait();
  if (!engine) return std::unexpected(engine.error());
  FrameContext context{.request = request,
                       .job = *job,
                       .version = kVersion,
                       .backend = std::string((*engine)->backend_name()),
                       .cpu_features = (*engine)->cpu_features(),
                       .trace = call->trace()};
  const u64 frame_bytes = frame_bytes_of(**job);
  return RenderTask{.job = *std::move(job),
                    .headers = std::make_shared<FrameHeaders>(std::move(context)),
                    .engine = *engine,
                    .tenant = session.tenant(),
                    .call = std::move(call),
                    .frame_bytes = frame_bytes};
}

Status RenderTask::charge(u64 request_bytes) {
  auto taken = Charge::take(tenant->ledger.bytes, charged(request_bytes));
  if (!taken) return std::unexpected(std::move(taken).error());
  request = std::move(*taken);
  return {};
}

FrameCutter::Begun note_frames(const Daemon& daemon, const grpc::ServerContextBase& context) {
  if (!daemon.recorder) return {};
  return [recorder = daemon.recorder.get(), &context](const std::shared_ptr<const Frame>& frame) {
    recorder->frame(&context, frame);
  };
}

Expected<Charge> count_job(const Engine& engine, Tenant& tenant) {
  HELIO_TRY(tenant.samples.admit());
  HELIO_TRY(tenant.ledger.bytes->admit(Work::kJobs));
  auto running = Charge::take(tenant.ledger.jobs, 1);
  if (!running) running.error().retry_seconds = retry_seconds(engine);
  return running;
}

Status submit(Daemon& daemon, RenderTask& task, std::shared_ptr<JobSink> sink,
              std::stop_token stop) {
  auto running = count_job(*task.engine, *task.tenant);
  if (!running) return std::unexpected(std::move(running).error());
  auto frames = frame_room(task);
  if (!frames) return std::unexpected(std::move(frames).error());
  auto metered = std::make_shared<Metered>(
      std::move(sink), daemon, task,
      Metered::Charges{std::move(*running), std::move(task.request), std::move(*frames)});
  HELIO_TRY(task.engine->submit(task.job, std::move(metered), std::move(stop)));
  task.headers->write_ahead();
  return {};
}

}  // namespace heliograph::server
