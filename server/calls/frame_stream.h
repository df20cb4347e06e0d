// Frames in flight to a client: a mailbox between the device thread and gRPC, which has one write
// in flight.
#pragma once

#include <deque>
#include <memory>
#include <mutex>
#include <optional>

#include "renderer/schedule/engine.h"
#include "server/calls/call_scope.h"
#include "server/calls/daemon.h"
#include "server/calls/frame_cutter.h"
#include "server/calls/render_task.h"
#include "server/observe/stall_monitor.h"

namespace heliograph::server {

/// The reply side of Render.
///
/// The mailbox holds at most one progress message, one intermediate frame per camera (a newer one
/// replaces it) and each camera's final frame. Chunks are cut when they are written, so a slow
/// reader holds only the frames of its own job and stalls no other. Thread: any; sink calls come
/// from the device thread and never block. Lifetime: owns itself until gRPC is done; the engine
/// holds it as its sink.
class FrameStream final : public grpc::ServerWriteReactor<v1::FramePart>,
                          public JobSink,
                          public Monitored {
 public:
  [[nodiscard]] static std::shared_ptr<FrameStream> start(Daemon& daemon,
                                                          grpc::CallbackServerContext& context,
                                                          Call call);

  /// Sets which frames will come. Called once, before the engine has the sink.
  void expect(const RenderTask& task);
  [[nodiscard]] const CallScope& scope() const { return scope_; }
  [[nodiscard]] Status provide(const RenderTask& task) {
    return cutter_.provide(*task.job, *task.engine);
  }

  void progress(const Progress& progress) override;
  void frame(std::shared_ptr<const Frame> frame) override;
  void done(Status status, const Spent& spent) override;
  /// Ends a call that was never submitted.
  void refuse(const Status& status) { done(status, {}); }

  void OnWriteDone(bool ok) override;
  void OnCancel() override { scope_.request_stop(); }
  void OnDone() override;
  void on_tick(EventLoop::Clock::time_point now) override;

 private:
  FrameStream(Daemon& daemon, grpc::CallbackServerContext& context, Call call);
  void pump();
  [[nodiscard]] bool next_part();           // fills part_; under mutex_
  [[nodiscard]] bool is_last_part() const;  // under mutex_

  CallScope scope_;
  const double stall_seconds_;
  std::shared_ptr<FrameHeaders> headers_;
  std::shared_ptr<FrameStream> self_;  // until OnDone

  std::mutex mutex_;
  std::optional<Progress> progress_;
  std::deque<std::shared_ptr<const Frame>> frames_;
  u32 finals_left_ = 0;  // final frames still to come
  std::optional<Status> result_;
  FrameCutter cutter_;
  Standstill standstill_;
  bool has_sent_progress_ = false;
  bool is_writing_ = false;
  bool is_finished_ = false;
  v1::FramePart part_;
};

}  // namespace heliograph::server
