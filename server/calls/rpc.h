// Calls as gRPC reactors: unary, server stream, refusal. Every gRPC handler of service_*.cpp goes
// through these, so that all calls pass the gate and all errors are converted in one place.
#pragma once

#include <grpc/support/time.h>

#include <chrono>
#include <functional>
#include <optional>
#include <stop_token>

#include "server/calls/daemon.h"
#include "server/convert/error.h"
#include "server/convert/transaction.h"
#include "server/observe/call_record.h"
#include "server/os/work_pool.h"
#include "server/session/gate.h"

namespace heliograph::server {

/// Returns the client's deadline on the jobs' clock; none when it has none.
[[nodiscard]] inline std::optional<std::chrono::steady_clock::time_point> deadline_of(
    const grpc::CallbackServerContext& context) {
  const gpr_timespec deadline = context.raw_deadline();
  if (gpr_time_cmp(deadline, gpr_inf_future(deadline.clock_type)) == 0) return std::nullopt;
  const gpr_timespec left = gpr_time_sub(deadline, gpr_now(deadline.clock_type));
  return std::chrono::steady_clock::now() + std::chrono::seconds(left.tv_sec) +
         std::chrono::nanoseconds(left.tv_nsec);
}

/// Ends a call of any shape at once.
template <class Reactor>
class Refusal final : public Reactor {
 public:
  Refusal(grpc::CallbackServerContext& context, const Error& error) {
    this->Finish(to_status(error, context));
  }
  void OnDone() override { delete this; }
};

/// Copies the caller's identity into the log's facts.
inline void name_caller(const Call& call, CallFacts& facts) {
  facts.tenant = call.tenant()->name;
  if (!call.session()) return;
  facts.client = call.session()->client();
  facts.session = call.session()->id();
}

/// Admits a call and starts it with `start(Call) -> Reactor*`, or refuses it: the only way from a
/// handler of Service to a session.
template <class Reactor, class Start>
Reactor* let_in(Gate& gate, grpc::CallbackServerContext* context, Needs needs, const Start& start) {
  const BusyTimes::Scope busy(gate.reactions());
  auto admitted = gate.admit(*context, needs);
  if (!admitted) return new Refusal<Reactor>(*context, admitted.error());
  record_of(*context)->note([&](CallFacts& facts) { name_caller(*admitted, facts); });
  return start(std::move(*admitted));
}

/// The same for a call whose request has arrived, charged until the call ends. UNIMPLEMENTED when
/// it has unknown fields.
template <class Reactor, class Start>
Reactor* let_in(Gate& gate, grpc::CallbackServerContext* context,
                const google::protobuf::Message& request, Needs needs, const Start& start) {
  return let_in<Reactor>(gate, context, needs, [&](Call call) -> Reactor* {
    if (auto known = check_known(request); !known)
      return new Refusal<Reactor>(*context, known.error());
    if (auto room = call.charge(request.ByteSizeLong()); !room)
      return new Refusal<Reactor>(*context, room.error());
    return start(std::move(call));
  });
}

/// A unary call in flight. The handler calls finish() once, from any thread; until then request and
/// reply are alive.
class UnaryCall final : public grpc::ServerUnaryReactor {
 public:
  UnaryCall(grpc::CallbackServerContext& context, Call call)
      : context_(context), call_(std::move(call)) {}

  [[nodiscard]] const TenantPtr& tenant() const { return call_.tenant(); }
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return call_.session(); }
  [[nodiscard]] grpc::CallbackServerContext& context() const { return context_; }
  /// Stops when the client cancels, its deadline passes or its connection ends.
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }

  void finish(const Status& status) {
    call_.release_slot();
    Finish(to_status(status, context_));
  }
  /// Posts work that finishes the call; a full pool finishes it too.
  void post(WorkPool& pool, WorkPool::Task task) {
    if (auto posted = pool.post(tenant()->id, std::move(task)); !posted) finish(posted);
  }

  void OnCancel() override { stop_.request_stop(); }
  void OnDone() override { delete this; }

 private:
  grpc::CallbackServerContext& context_;
  Call call_;
  std::stop_source stop_;
};

template <class Handler>
grpc::ServerUnaryReactor* unary(Gate& gate, grpc::CallbackServerContext* context,
                                const google::protobuf::Message& request, Needs needs,
                                const Handler& handler) {
  using Reactor = grpc::ServerUnaryReactor;
  return let_in<Reactor>(gate, context, request, needs, [&](Call admitted) {
    auto* call = new UnaryCall(*context, std::move(admitted));
    handler(*call);
    return call;
  });
}

/// A server stream whose messages are made one at a time, on the pool, once the previous one was
/// written: nothing queues up behind a slow reader, and a stalled one is closed.
template <class Reply>
class PullStream final : public grpc::ServerWriteReactor<Reply>, public Monitored {
 public:
  /// Fills the next message; false when there is none.
  using Next = std::function<Expected<bool>(Reply&)>;

  /// Makes a stream that waits for pull() or finish(); exactly one of them is called, once.
  static PullStream* make(Daemon& daemon, grpc::CallbackServerContext& context, Call call) {
    std::shared_ptr<PullStream> made(new PullStream(daemon, context, std::move(call)));
    made->self_ = made;
    daemon.stall_monitor.add(made);
    return made.get();
  }

  [[nodiscard]] const TenantPtr& tenant() const { return call_.tenant(); }
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return call_.session(); }
  [[nodiscard]] grpc::CallbackServerContext& context() const { return context_; }
  /// Stops when the client cancels, its deadline passes or its connection ends.
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }

  /// Holds a charge until the call ends.
  void hold(Charge answer) { answer_ = std::move(answer); }
  /// Sends the messages that `next` makes, until there are no more.
  void pull(Next next) {
    next_ = std::move(next);
    step();
  }
  void finish(const Status& status) {
    call_.release_slot();
    this->Finish(to_status(status, context_));
  }

  void OnWriteDone(bool ok) override {
    {
      const std::lock_guard lock(mutex_);
      is_writing_ = false;
    }
    if (ok) return step();
    this->Finish(grpc::Status::CANCELLED);
  }
  void OnCancel() override { stop_.request_stop(); }
  void OnDone() override {
    end_ticks();
    self_.reset();
  }
  void on_tick(EventLoop::Clock::time_point now) override {
    bool is_stuck;
    {
      const std::lock_guard lock(mutex_);
      is_stuck = is_writing_ && standstill_.is_longer_than(stall_seconds_, now);
    }
    if (is_stuck) context_.TryCancel();
  }

 private:
  PullStream(Daemon& daemon, grpc::CallbackServerContext& context, Call call)
      : context_(context),
        call_(std::move(call)),
        pool_(daemon.pool),
        stall_seconds_(double(daemon.config.limits.stall_seconds)) {}

  void step() {
    if (auto posted = pool_.post(call_.tenant()->id, [this] { advance(); }); !posted)
      finish(posted);
  }
  void advance() {
    if (context_.IsCancelled()) return this->Finish(grpc::Status::CANCELLED);
    reply_.Clear();
    const auto more = next_(reply_);
    if (!more || !*more) {
      next_ = nullptr;  // frees its captures, which may be large
      return finish(more ? Status{} : std::unexpected(more.error()));
    }
    {
      const std::lock_guard lock(mutex_);
      is_writing_ = true;
      standstill_.moved();
    }
    this->StartWrite(&reply_);
  }

  grpc::CallbackServerContext& context_;
  Call call_;
  Charge answer_;
  std::stop_source stop_;
  WorkPool& pool_;
  const double stall_seconds_;
  Next next_;
  Reply reply_;
  std::mutex mutex_;
  bool is_writing_ = false;
  Standstill standstill_;
  std::shared_ptr<PullStream> self_;  // until OnDone
};

/// Admits a server stream and starts it with what `prepare` returns for the session.
template <class Reply, class Prepare>
grpc::ServerWriteReactor<Reply>* pull(Daemon& daemon, grpc::CallbackServerContext* context,
                                      const google::protobuf::Message& request,
                                      const Prepare& prepare) {
  using Reactor = grpc::ServerWriteReactor<Reply>;
  return let_in<Reactor>(daemon.gate, context, request, Needs::kSession, [&](Call call) {
    auto next = prepare(call.session());
    auto* stream = PullStream<Reply>::make(daemon, *context, std::move(call));
    stream->pull(std::move(next));
    return stream;
  });
}

}  // namespace heliograph::server
