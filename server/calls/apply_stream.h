// ApplyStream: numbered transactions one after another; replies in order, refusals included.
#pragma once

#include <memory>
#include <mutex>
#include <optional>

#include "server/calls/call_scope.h"
#include "server/calls/service.h"
#include "server/observe/stall_monitor.h"

namespace heliograph::server {

/// Executes one transaction at a time; those sent ahead wait in gRPC's flow-control window. The one
/// in work gets its reply before the call ends. Lifetime: owns itself until gRPC is done.
class ApplyStreamCall final : public grpc::ServerBidiReactor<v1::ApplyRequest, v1::ApplyReply>,
                              public Monitored {
 public:
  [[nodiscard]] static ApplyStreamCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                              Call call);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone() override {
    end_ticks();
    self_.reset();
  }
  void on_tick(EventLoop::Clock::time_point now) override;

 private:
  ApplyStreamCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call)
      : daemon_(daemon), scope_(context, std::move(call)) {}
  void answer(const EditLog::Reply& answer);
  void read();
  void end(Status status);
  void rest();
  void finish(const Status& status) { Finish(to_status(status, scope_.context())); }

  Daemon& daemon_;
  CallScope scope_;
  std::shared_ptr<ApplyStreamCall> self_;  // until OnDone
  v1::ApplyRequest request_;
  v1::ApplyReply reply_;

  std::mutex mutex_;
  u32 busy_ = 1;  // operations in progress: a transaction, a reply, a read
  bool is_writing_ = false;
  bool is_finished_ = false;
  std::optional<Status> result_;  // status to end with, once busy_ is 0
};

}  // namespace heliograph::server
