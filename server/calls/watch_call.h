// Watch: the transactions of a scene, at their reader's pace.
#pragma once

#include "server/calls/call_scope.h"
#include "server/calls/daemon.h"
#include "server/calls/service.h"
#include "server/observe/stall_monitor.h"

namespace heliograph::server {

/// A checked Watch request.
struct WatchOrder {
  u64 scene = 0;
  std::shared_ptr<SceneEvents> events;
  Revision next = 0;  // the first revision to send
  double bookmark_seconds = 0;
  Charge counted;  // charge of the tenant's streams
};

/// Holds a revision number and the message in flight, however slow its reader is: the events belong
/// to the scene. Thread: any; one thread at a time is busy with it, on the work pool. Lifetime:
/// owns itself until gRPC is done.
class WatchCall final : public grpc::ServerWriteReactor<v1::WatchReply>,
                        public Monitored,
                        public std::enable_shared_from_this<WatchCall> {
 public:
  [[nodiscard]] static WatchCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                        Call call, WatchOrder order);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override {
    end_ticks();
    self_.reset();
  }
  void on_tick(EventLoop::Clock::time_point now) override;

 private:
  WatchCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call, WatchOrder order);
  [[nodiscard]] Status follow();
  void advance();
  void post_work();
  void work();
  [[nodiscard]] Expected<bool> next_message();
  void finish(const Status& status);

  Daemon& daemon_;
  CallScope scope_;
  std::shared_ptr<WatchCall> self_;  // until OnDone
  // Accessed by the busy thread only.
  WatchOrder order_;
  v1::WatchReply reply_;
  SceneEvents::Event event_;

  SceneEntry::Watch watch_;
  std::mutex mutex_;
  bool is_busy_ = false;      // a thread works on it, a message is in flight, or it is finished
  bool is_notified_ = false;  // notified since the busy thread last checked
  bool is_writing_ = false;
  bool is_bookmark_due_ = true;
  std::optional<Status> result_;  // status to end with, once everything is sent
  Standstill standstill_;         // time since the last message was started
};

/// Checks a request. NOT_FOUND, OUT_OF_RANGE, INVALID_ARGUMENT, RESOURCE_EXHAUSTED.
[[nodiscard]] Expected<WatchOrder> to_order(Daemon& daemon, const Session& session,
                                            const v1::WatchRequest& request);

}  // namespace heliograph::server
