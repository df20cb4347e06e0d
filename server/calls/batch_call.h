// RenderBatch: independent items, answered one after another as they are done.
#pragma once

#include <deque>

#include "server/calls/call_scope.h"
#include "server/calls/render_task.h"
#include "server/calls/service.h"
#include "server/observe/call_watch.h"

namespace heliograph::server {

/// Items wait until there is a credit, then are in work, then done with their frames, then sent.
/// A slow reader costs the frames of as many items as it has credits.
/// Thread: any; one mutex, never held across a call outwards.
/// Lifetime: holds itself until gRPC is done; its items hold it.
class BatchCall final
    : public grpc::ServerBidiReactor<v1::RenderBatchRequest, v1::RenderBatchReply>,
      public Watched,
      public std::enable_shared_from_this<BatchCall> {
 public:
  using Request = v1::RenderBatchRequest;
  using Reply = v1::RenderBatchReply;

  /// `counted`: its share of the tenant's streams.
  [[nodiscard]] static BatchCall* start(Daemon& daemon, grpc::CallbackServerContext& context,
                                        Call call, Charge counted);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;
  void look(EventLoop::Clock::time_point now) override;

 private:
  class Item;
  using ItemPtr = std::shared_ptr<Item>;

  BatchCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call);
  [[nodiscard]] Status take(v1::RenderBatchRequest request);
  void end_reading();
  [[nodiscard]] u32 outstanding() const;  // items that use a credit; under mutex_
  void advance();                         // starts what may start, sends what can be sent
  [[nodiscard]] ItemPtr next_item();
  void on_done(ItemPtr item);
  void pump();
  [[nodiscard]] bool next_reply();  // fills reply_; under mutex_
  void close(Status status);        // under mutex_: the first one counts; what is in work stops

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
  u32 window_ = 0;  // credits of the first message; 0: there was none yet
  u32 credits_ = 0;
  std::optional<Status> result_;
  Standstill standstill_;
  bool is_read_ = false;  // the client half-closed
  bool is_writing_ = false;
  bool is_finished_ = false;
};

}  // namespace heliograph::server
