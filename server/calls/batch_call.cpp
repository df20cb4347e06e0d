// Credits, items and their order. See batch_call.h.
#include "server/calls/batch_call.h"

#include <utility>

#include "server/convert/error.h"
#include "server/convert/fields.h"
#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

constexpr u64 kItemBytes = 1024;  // memory per item beyond its message

}  // namespace

/// An item: a request, then a job, then its frames and status.
class BatchCall::Item final : public JobSink, public std::enable_shared_from_this<Item> {
 public:
  Item(std::shared_ptr<BatchCall> call, v1::RenderBatchRequest request)
      : call_(std::move(call)), request_(std::move(request)) {}

  [[nodiscard]] u64 tag() const { return request_.tag(); }
  [[nodiscard]] u64 bytes() const { return request_.ByteSizeLong() + kItemBytes; }
  /// Starts the item. May take long: runs on the work pool.
  void start() {
    if (auto started = submit_job(); !started) done(started, {});
  }

  void progress(const Progress&) override {}
  void frame(std::shared_ptr<const Frame> frame) override {
    frames_.push_back({std::move(frame), headers_});
  }
  void done(Status status, const Spent&) override {
    status_ = std::move(status);
    call_->on_done(shared_from_this());
  }

  // Valid after done().
  [[nodiscard]] const Status& status() const { return status_; }
  [[nodiscard]] std::deque<OutgoingFrame>& frames() { return frames_; }

 private:
  Status submit_job() {
    const CallScope& scope = call_->scope_;
    if (scope.is_stopped()) return fail(Code::kCancelled, "", "cancelled by the client");
    if (request_.job().progressive())
      return fail(Code::kInvalidArgument, "job.progressive",
                  "a batch answers with final frames; leave it out, or use Render or Stream");
    auto task =
        to_task(call_->daemon_, *scope.session(), request_.job(), record_of(scope.context()));
    if (!task) return std::unexpected(std::move(task).error().at("job"));
    HELIO_CHECK(task->charge(bytes()), "job");
    task->job->deadline = scope.deadline();
    if (auto provided = call_->cutter_.provide(*task->job, *task->engine); !provided)
      return std::unexpected(std::move(provided).error().at("job"));
    headers_ = task->headers;
    return submit(call_->daemon_, *task, shared_from_this(), scope.stop());
  }

  std::shared_ptr<BatchCall> call_;
  const v1::RenderBatchRequest request_;
  std::shared_ptr<FrameHeaders> headers_;
  std::deque<OutgoingFrame> frames_;
  Status status_;
};

BatchCall* BatchCall::start(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
                            Charge counted) {
  std::shared_ptr<BatchCall> made(new BatchCall(daemon, context, std::move(call)));
  made->self_ = made;
  made->counted_ = std::move(counted);
  made->waiting_charge_ = Charge::none(made->scope_.session()->tenant()->ledger.bytes);
  daemon.stall_monitor.add(made);
  made->StartRead(&made->request_);
  return made.get();
}

BatchCall::BatchCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call)
    : daemon_(daemon),
      scope_(context, std::move(call)),
      cutter_(daemon.config.limits.chunk_bytes, scope_.session(), note_frames(daemon, context)) {}

void BatchCall::OnReadDone(bool ok) {
  if (ok) {
    if (auto taken = take(std::exchange(request_, {})); taken) {
      StartRead(&request_);
    } else {
      const std::lock_guard lock(mutex_);
      close(taken);
    }
  } else {
    end_reading();
  }
  advance();
}

Status BatchCall::take(v1::RenderBatchRequest request) {
  HELIO_TRY(check_own_fields(request));
  const Limits& limits = daemon_.config.limits;
  const std::lock_guard lock(mutex_);
  if (result_) return {};  // it will get no reply; an item kept here would keep the call alive
  u64 credits = request.credits();
  if (window_ == 0 && credits == 0) credits = kDefaultCredits;
  HELIO_TRY(check_credits(credits + credits_ + outstanding(), limits));
  if (window_ == 0) window_ = u32(credits);
  credits_ += u32(credits);
  standstill_.moved();
  if (!request.has_job()) return {};
  auto item = std::make_shared<Item>(shared_from_this(), std::move(request));
  waiting_bytes_ += item->bytes();
  HELIO_TRY(check_waiting(waiting_bytes_, limits,
                          {"", "more items", "send the next one when an item was answered"}));
  HELIO_TRY(waiting_charge_.resize(charged(waiting_bytes_)));
  waiting_.push_back(std::move(item));
  return {};
}

/// The client can return credits no more: from now on each sent item returns one.
void BatchCall::end_reading() {
  const std::lock_guard lock(mutex_);
  client_half_closed_ = true;
  credits_ = std::max(window_, outstanding()) - outstanding();
}

u32 BatchCall::outstanding() const { return in_work_ + u32(done_.size()) + (sending_ ? 1 : 0); }

void BatchCall::advance() {
  const u64 tenant = scope_.session()->tenant()->id;
  while (const ItemPtr item = next_item())
    if (auto posted = daemon_.pool.post(tenant, [item] { item->start(); }); !posted)
      item->done(posted, {});
  pump();
}

BatchCall::ItemPtr BatchCall::next_item() {
  const std::lock_guard lock(mutex_);
  if (waiting_.empty() || credits_ == 0 || result_ || scope_.is_stopped()) return nullptr;
  ItemPtr item = std::move(waiting_.front());
  waiting_.pop_front();
  waiting_bytes_ -= item->bytes();
  [[maybe_unused]] const auto given_back = waiting_charge_.resize(charged(waiting_bytes_));
  --credits_;
  ++in_work_;
  return item;
}

void BatchCall::on_done(ItemPtr item) {
  {
    const std::lock_guard lock(mutex_);
    if (!is_writing_ && done_.empty()) standstill_.moved();
    --in_work_;
    const Status& status = item->status();
    // The deadline applies to the whole batch: the client learns so, whichever check notices first.
    if (!status && status.error().code == Code::kDeadlineExceeded) close(status);
    done_.push_back(std::move(item));
  }
  pump();
}

/// Starts the next write, or finishes; the only place that does either.
void BatchCall::pump() {
  Status result;
  bool is_reply;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    if (scope_.is_stopped()) close(fail(Code::kCancelled, "", "cancelled by the client"));
    if (result_) waiting_.clear(), done_.clear(), sending_.reset(), cutter_.drop();
    is_reply = next_reply();
    const bool is_over = in_work_ == 0 && (result_ || (client_half_closed_ && waiting_.empty()));
    if (!is_reply && !is_over) return;
    (is_reply ? is_writing_ : is_finished_) = true;
    if (result_) result = *result_;
  }
  if (is_reply) return StartWrite(&reply_);
  Finish(to_status(scope_.session()->with_shutdown_reason(result), scope_.context()));
}

bool BatchCall::next_reply() {
  if (!sending_) {
    if (done_.empty()) return false;
    sending_ = std::move(done_.front());
    done_.pop_front();
  }
  reply_.Clear();
  reply_.set_tag(sending_->tag());
  if (cutter_.next(*reply_.mutable_part())) return true;
  if (!sending_->frames().empty()) {
    cutter_.begin(std::move(sending_->frames().front()), *reply_.mutable_part());
    sending_->frames().pop_front();
    return true;
  }
  reply_.clear_part();
  reply_.set_done(true);
  if (const Status& status = sending_->status(); !status)
    *reply_.mutable_status() = to_proto(status.error());
  sending_.reset();
  if (client_half_closed_) ++credits_;
  return true;
}

void BatchCall::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    standstill_.moved();
  }
  if (!ok) scope_.request_stop();
  advance();
}

void BatchCall::close(Status status) {
  if (!result_) result_ = std::move(status);
  scope_.request_stop();
}

void BatchCall::OnCancel() {
  scope_.request_stop();
  pump();
}

void BatchCall::OnDone() {
  end_ticks();
  if (scope_.is_stopped()) cutter_.abandon();
  self_.reset();
}

void BatchCall::on_tick(EventLoop::Clock::time_point now) {
  Status known = scope_.check_identity(daemon_.gate);
  bool is_stuck;
  {
    const std::lock_guard lock(mutex_);
    if (!known) close(std::move(known));
    is_stuck =
        is_writing_ && standstill_.is_longer_than(double(daemon_.config.limits.stall_seconds), now);
  }
  if (is_stuck) scope_.context().TryCancel();
  if (scope_.is_stopped()) pump();
}

}  // namespace heliograph::server
