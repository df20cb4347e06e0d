// A RenderRequest from the wire to the engine. Called by Render, RenderBatch and Stream.
#pragma once

#include <stop_token>

#include "server/calls/daemon.h"
#include "server/calls/frame_cutter.h"

namespace heliograph::server {

/// A request that was checked.
struct RenderTask {
  std::shared_ptr<RenderJob> job;
  std::shared_ptr<FrameHeaders> headers;
  Engine* engine = nullptr;
  TenantPtr tenant;
  CallRecordPtr call;
  u64 frame_bytes = 0;
  Charge request{};  // of a call of many

  /// Charges its request to its tenant, until it ends. RESOURCE_EXHAUSTED.
  [[nodiscard]] Status charge(u64 request_bytes);
};

/// Resolves the revision, applies the overlay, checks every field. Waits for the engine to start,
/// so call it on the work pool.
///
/// call   that it is a part of
[[nodiscard]] Expected<RenderTask> to_task(Daemon& daemon, Session& session,
                                           const v1::RenderRequest& request, CallRecordPtr call);

/// Queues it and counts it for its tenant; RESOURCE_EXHAUSTED with a retry time when too much waits
/// or runs.
[[nodiscard]] Status submit(Daemon& daemon, RenderTask& task, std::shared_ptr<JobSink> sink,
                            std::stop_token stop);

/// Counts a job or a query for its tenant, while it waits and runs. RESOURCE_EXHAUSTED with a retry
/// time.
[[nodiscard]] Expected<Charge> count_job(const Engine& engine, Tenant& tenant);

/// What a call tells the recorder of its frames; empty when nothing is recorded.
[[nodiscard]] FrameCutter::Begun note_frames(const Daemon& daemon,
                                             const grpc::ServerContextBase& context);

}  // namespace heliograph::server
