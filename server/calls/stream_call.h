// Stream: a live picture of a scene, at its reader's pace.
#pragma once

#include <deque>

#include "server/calls/call_scope.h"
#include "server/calls/render_task.h"
#include "server/calls/service.h"
#include "server/observe/stall_monitor.h"

namespace heliograph::server {

/// Runs one job at a time, for the newest settings and revision. The next one starts when there is
/// something newer to show, no frame waits and a credit is available: a slow reader holds the frame
/// being sent and one waiting frame per camera, and no device time. Thread: any; one mutex, never
/// held across outward calls. Lifetime: owns itself until gRPC is done; its job owns it too.
class StreamCall final : public grpc::ServerBidiReactor<v1::StreamRequest, v1::FramePart>,
                         public Monitored,
                         public std::enable_shared_from_this<StreamCall> {
 public:
  using Request = v1::StreamRequest;
  using Reply = v1::FramePart;

  /// counted   its charge of the tenant's streams
  [[nodiscard]] static StreamCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                         Call call, Charge counted);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  void on_tick(EventLoop::Clock::time_point now) override;

 private:
  class Job;
  using Settings = std::shared_ptr<const v1::RenderRequest>;

  StreamCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call);
  [[nodiscard]] Status take(v1::StreamRequest request);
  [[nodiscard]] Status begin(const v1::StreamRequest& first);  // under mutex_, like those below
  [[nodiscard]] Status add(v1::RenderRequest settings);
  [[nodiscard]] bool has_news() const;
  [[nodiscard]] std::shared_ptr<Job> next_job();
  [[nodiscard]] bool next_part();
  [[nodiscard]] bool is_waited_for() const { return is_writing_ || !frames_.empty(); }
  void close(Status status);

  void advance();  // starts or interrupts a job, sends what is ready
  void pump();
  [[nodiscard]] Status follow(u64 scene);
  void on_revision(Revision revision);
  void on_frame(OutgoingFrame frame);
  void on_done(Status status);

  Daemon& daemon_;
  CallScope scope_;
  Charge counted_;
  const u64 line_;
  std::shared_ptr<StreamCall> self_;  // until OnDone
  v1::StreamRequest request_;
  v1::FramePart part_;

  std::mutex mutex_;
  std::deque<Settings> pending_;  // latest: at most one
  u64 pending_bytes_ = 0;
  Charge pending_charge_;
  Settings settings_;  // of the last job
  u64 scene_ = 0;
  SceneEntry::Watch watch_;
  Revision head_ = 0;        // of the scene, as last notified
  Revision shown_ = 0;       // of the last job
  bool is_refused_ = false;  // the last job was refused for now; retried at retry_at_
  EventLoop::Clock::time_point retry_at_;
  std::shared_ptr<Job> job_;
  std::deque<OutgoingFrame> frames_;
  FrameCutter cutter_;
  u32 credits_ = 0;
  std::optional<Status> result_;
  Standstill standstill_;
  bool has_begun_ = false;
  bool is_lossless_ = false;
  bool client_half_closed_ = false;
  bool is_writing_ = false;
  bool is_finished_ = false;
};

}  // namespace heliograph::server
