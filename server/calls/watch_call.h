// Watch: the transactions of a scene, as fast as their reader takes them.
#pragma once

#include "server/calls/call_scope.h"
#include "server/calls/daemon.h"
#include "server/calls/service.h"
#include "server/observe/call_watch.h"

namespace heliograph::server {

/// What a Watch asks for, checked.
struct WatchOrder {
  u64 scene = 0;
  std::shared_ptr<SceneEvents> events;
  Revision next = 0;  // the first revision to send
  double bookmark_seconds = 0;
  Charge counted;  // its share of the tenant's streams
};

/// It holds a revision and the message on its way, however slow its reader is: the events are the
/// scene's. Thread: any; one at a time is busy with it, on the work pool.
/// Lifetime: holds itself until gRPC is done.
class WatchCall final : public grpc::ServerWriteReactor<v1::WatchReply>,
                        public Watched,
                        public std::enable_shared_from_this<WatchCall> {
 public:
  [[nodiscard]] static WatchCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                        Call call, WatchOrder order);

  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override {
    end_looks();
    self_.reset();
  }
  void look(EventLoop::Clock::time_point now) override;

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
  // Of the one that is busy.
  WatchOrder order_;
  v1::WatchReply reply_;
  SceneEvents::Event event_;

  SceneEntry::Watch watch_;
  std::mutex mutex_;
  bool is_busy_ = false;  // somebody works on it, a message is on its way, or it is finished
  bool is_told_ = false;  // since the one that is busy looked
  bool is_writing_ = false;
  bool is_bookmark_due_ = true;
  std::optional<Status> result_;  // how it ends, once all is sent
  Standstill standstill_;         // since the last message was begun
};

/// The order of a request. NOT_FOUND, OUT_OF_RANGE, INVALID_ARGUMENT, RESOURCE_EXHAUSTED.
[[nodiscard]] Expected<WatchOrder> to_order(Daemon& daemon, const Session& session,
                                            const v1::WatchRequest& request);

}  // namespace heliograph::server
