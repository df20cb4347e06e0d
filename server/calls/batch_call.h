// RenderBatch: independent items, replied to in order of completion.
#pragma once

#include <deque>

#include "server/calls/call_scope.h"
#include "server/calls/render_task.h"
#include "server/calls/service.h"
#include "server/observe/stall_monitor.h"

namespace heliograph::server {

/// States of an item: waiting for a credit, in work, done with its frames, sent. A slow reader
/// holds the frames of at most as many items as it has credits. Thread: any; one mutex, never held
/// across outward calls. Lifetime: owns itself until gRPC is done; its items own it too.
class BatchCall final
    : public grpc::ServerBidiReactor<v1::RenderBatchRequest, v1::RenderBatchReply>,
      public Monitored,
      public std::enable_shared_from_this<BatchCall> {
 public:
  using Request = v1::RenderBatchRequest;
  using Reply = v1::RenderBatchReply;

  /// counted   its charge of the tenant's streams
  [[nodiscard]] static BatchCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                        Call call, Charge counted);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  void on_tick(EventLoop::Clock::time_point now) override;

 private:
  class Item;
  using ItemPtr = std::shared_ptr<Item>;

  BatchCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call);
  [[nodiscard]] Status take(v1::RenderBatchRequest request);
  void end_reading();
  [[nodiscard]] u32 outstanding() const;  // items that use a credit; under mutex_
  void advance();                         // starts items that have credits, sends what is ready
  [[nodiscard]] ItemPtr next_item();
  void on_done(ItemPtr item);
  void pump();
  [[nodiscard]] bool next_reply();  // fills reply_; under mutex_
  void close(Status status);  // under mutex_: the first status counts; items in work are stopped

  Daemon& daemon_;
  CallScope scope_;
  Charge counted_;
  std::shared_ptr<BatchCall> self_;  // until OnDone
  v1::RenderBatchRequest request_;
  v1::RenderBatchReply reply_;

  std::mutex mutex_;
  std::deque<ItemPtr> waiting_;
  u64 waiting_bytes_ = 0;
  Charge waiting_charge_;
  std::deque<ItemPtr> done_;
  ItemPtr sending_;
  FrameCutter cutter_;
  u32 in_work_ = 0;
  u32 window_ = 0;  // credits of the first message; 0: it has not arrived
  u32 credits_ = 0;
  std::optional<Status> result_;
  Standstill standstill_;
  bool client_half_closed_ = false;
  bool is_writing_ = false;
  bool is_finished_ = false;
};

}  // namespace heliograph::server
