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
};

/// Resolves the revision, applies the overlay, checks every field. Waits for the engine to start,
/// so call it on the work pool.
///
/// call   that it is a part of
[[nodiscard]] Expected<RenderTask> to_task(Daemon& daemon, Session& session,
                                           const v1::RenderRequest& request, CallRecordPtr call);

/// Queues it and counts it for its tenant; RESOURCE_EXHAUSTED with a retry time when too much waits
/// or runs.
[[nodiscard]] Status submit(Daemon& daemon, const RenderTask& task, std::shared_ptr<JobSink> sink,
                            std::stop_token stop);

/// What a call tells the recorder of its frames; empty when nothing is recorded.
[[nodiscard]] FrameCutter::Begun note_frames(const Daemon& daemon,
                                             const grpc::ServerContextBase& context);

}  // namespace heliograph::server
