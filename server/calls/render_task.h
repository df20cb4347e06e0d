// Turns a RenderRequest into a job of the engine. Called by Render, RenderBatch, Stream and quick
// calls.
#pragma once

#include <stop_token>

#include "server/calls/daemon.h"
#include "server/calls/frame_cutter.h"

namespace heliograph::server {

/// A checked request.
struct RenderTask {
  std::shared_ptr<RenderJob> job;
  std::shared_ptr<FrameHeaders> headers;
  Engine* engine = nullptr;
  TenantPtr tenant;
  CallRecordPtr call;
  u64 frame_bytes = 0;
  Charge request{};  // charge of one request among several of a call

  /// Charges the request to its tenant until the task ends. RESOURCE_EXHAUSTED.
  [[nodiscard]] Status charge(u64 request_bytes);
};

/// Resolves the revision, applies the overlay and checks every field. Waits for the engine to
/// start: call it on the work pool.
///
/// call   the call it is part of
[[nodiscard]] Expected<RenderTask> to_task(Daemon& daemon, Session& session,
                                           const v1::RenderRequest& request, CallRecordPtr call);

/// Queues a job and charges it to its tenant. RESOURCE_EXHAUSTED with a retry time when too many
/// wait or run.
[[nodiscard]] Status submit(Daemon& daemon, RenderTask& task, std::shared_ptr<JobSink> sink,
                            std::stop_token stop);

/// Charges a job or query to its tenant while it waits and runs. RESOURCE_EXHAUSTED with a retry
/// time.
[[nodiscard]] Expected<Charge> count_job(const Engine& engine, Tenant& tenant);

/// Returns the function that passes a call's frames to the recorder; empty when nothing is
/// recorded.
[[nodiscard]] FrameCutter::Begun note_frames(const Daemon& daemon,
                                             const grpc::ServerContextBase& context);

}  // namespace heliograph::server
