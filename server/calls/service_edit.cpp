// Apply and ApplyStream.
#include "server/calls/apply_stream.h"
#include "server/calls/edit_calls.h"
#include "server/calls/rpc.h"
#include "server/convert/limits.h"
#include "server/convert/render.h"
#include "server/journal/sources.h"
#include "server/scene/scene_info.h"
#include "server/store/used_uploads.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kShortBytes = 64 << 10;  // checked in the caller's thread

EditLog::Reply refuse(Error error) {
  return std::make_shared<const Expected<v1::ApplyReply>>(std::unexpected(std::move(error)));
}

/// Reads the transaction of a request that its session may still make.
Expected<Transaction> read(Session& session, const v1::ApplyRequest& request, ArraySource& source,
                           const Limits& limits) {
  HELIO_TRY(check_own_fields(request));  // the transaction's own fields are checked below
  HELIO_TRY(check_count(request.transaction(), limits.edits));
  Rate& edits = session.tenant()->edits;
  HELIO_TRY(edits.admit());
  edits.charge(u64(request.transaction().edits_size()));
  return to_transaction(request.transaction(), source);
}

std::optional<Revision> expected_of(const v1::ApplyRequest& request) {
  return request.has_expected_revision() ? std::optional(request.expected_revision())
                                         : std::nullopt;
}

Expected<v1::ApplyReply> apply_now(Session& session, SceneEntry& entry,
                                   const v1::ApplyRequest& request, const Limits& limits) {
  UsedUploads source(session.arrays());
  const auto transaction = read(session, request, source, limits);
  const auto prepared =
      transaction ? entry.commit(*transaction, expected_of(request), request.transaction())
                  : std::unexpected(transaction.error());
  if (!prepared) {
    source.give_back(prepared.error());
    return std::unexpected(prepared.error());
  }
  return apply_reply(request.number(), *prepared);
}

void apply_durably(const std::shared_ptr<Session>& session, SceneEntry& entry,
                   const v1::ApplyRequest& request, const Limits& limits,
                   const EditLog::Finish& finish) {
  if (auto writing = entry.journal->status(); !writing)
    return finish(std::unexpected(writing.error()));
  UsedUploads uses(session->arrays());
  RecordingSource source(uses, entry.journal->files(entry.tenant->name));
  DurableEdit edit{.transaction = read(*session, request, source, limits),
                   .expected = expected_of(request),
                   .record = {},
                   .sent = {},
                   .files = {}};
  const auto end = [session, finish, used = uses.take_used()](Expected<v1::ApplyReply> reply) {
    if (!reply && may_be_sent_again(reply.error())) session->arrays().give_back(used);
    finish(std::move(reply));
  };
  edit.record.set_session(session->id());
  edit.record.set_number(request.number());
  if (edit.transaction && source.status())
    edit.sent = source.fill(request.transaction(), edit.record);
  if (!source.status()) {
    entry.journal->want_room();
    return end(std::unexpected(source.status().error()));
  }
  if (!edit.transaction && edit.transaction.error().retry_seconds > 0)
    return end(std::unexpected(std::move(edit.transaction).error()));
  edit.files = source.take_files();
  entry.commit(std::move(edit), end);
}

/// Returns true when checking takes microseconds: small, and no arrays outside the message.
bool is_short(const v1::ApplyRequest& request) {
  if (request.ByteSizeLong() > kShortBytes || has_arrays_elsewhere(request)) return false;
  return std::ranges::none_of(request.transaction().edits(), [](const v1::Edit& edit) {
    return edit.has_mesh() || edit.has_texture() || edit.has_instantiate() || edit.has_volume();
  });
}

}  // namespace

void apply_numbered(Daemon& daemon, const std::shared_ptr<Session>& session,
                    const v1::ApplyRequest& request,
                    const std::function<void(EditLog::Reply)>& done, bool may_take_long) {
  if (daemon.gate.is_closed()) return done(refuse(shutting_down().error()));
  const auto entry = daemon.scenes.find(request.scene(), *session);
  if (!entry) return done(refuse(entry.error()));
  const auto log = daemon.scenes.edits(**entry, session->id());
  if (auto open = check_open(*session); !open) {
    daemon.scenes.end_session(session->id());  // frees the log that this call may have recreated
    return done(refuse(std::move(open).error()));
  }
  auto task = [&request, session, entry = *entry, log, done, &daemon] {
    const auto apply = [&](const EditLog::Finish& finish) {
      if (entry->journal)
        return apply_durably(session, *entry, request, daemon.config.limits, finish);
      const auto change = daemon.scenes.write_barrier().begin();  // until the reply is sent
      if (!change) return finish(std::unexpected(change.error()));
      finish(apply_now(*session, *entry, request, daemon.config.limits));
    };
    log->answer(request.number(), apply, done);
  };
  if (auto queued = log->strand().run(std::move(task), may_take_long || is_short(request)); !queued)
    done(refuse(queued.error()));
}

grpc::ServerUnaryReactor* Service::Apply(Context* context, const v1::ApplyRequest* request,
                                         v1::ApplyReply* reply) {
  using Reactor = grpc::ServerUnaryReactor;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call admitted) -> Reactor* {
    if (auto room = admitted.charge(request->ByteSizeLong()); !room)
      return new Refusal<Reactor>(*context, room.error());
    auto* call = new UnaryCall(*context, std::move(admitted));
    apply_numbered(daemon_, call->session(), *request, [call, reply](const EditLog::Reply& answer) {
      if (!*answer) return call->finish(std::unexpected(answer->error()));
      *reply = **answer;
      call->finish({});
    });
    return call;
  });
}

grpc::ServerBidiReactor<v1::ApplyRequest, v1::ApplyReply>* Service::ApplyStream(Context* context) {
  using Reactor = grpc::ServerBidiReactor<v1::ApplyRequest, v1::ApplyReply>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call call) {
    return ApplyStreamCall::start(daemon_, *context, std::move(call));
  });
}

// ---------------------------------------------------------------- ApplyStreamCall

ApplyStreamCall* ApplyStreamCall::start(Daemon& daemon, grpc::CallbackServerContext& context,
                                        Call call) {
  std::shared_ptr<ApplyStreamCall> made(new ApplyStreamCall(daemon, context, std::move(call)));
  made->self_ = made;
  daemon.stall_monitor.add(made);
  made->read();
  return made.get();
}

/// Reads the next request. Called by a thread counted in busy_, whose count passes to the read.
void ApplyStreamCall::read() {
  StartRead(&request_);
  rest();
}

void ApplyStreamCall::OnReadDone(bool ok) {
  if (!ok) return end({});
  {
    const std::lock_guard lock(mutex_);
    if (is_finished_) return;
    ++busy_;
  }
  if (auto room = scope_.charge(request_.ByteSizeLong()); !room)
    return answer(refuse(std::move(room).error()));
  apply_numbered(daemon_, scope_.session(), request_,
                 [this](const EditLog::Reply& reply) { answer(reply); });
}

void ApplyStreamCall::answer(const EditLog::Reply& answer) {
  reply_.Clear();
  if (*answer) {
    reply_ = **answer;
  } else {
    reply_.set_number(request_.number());
    *reply_.mutable_status() = to_proto(answer->error());
  }
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = true;
  }
  StartWrite(&reply_);
}

void ApplyStreamCall::OnWriteDone(bool ok) {
  bool is_over;
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    if (!ok && !result_) result_ = fail(Code::kCancelled, "", "cancelled by the client");
    is_over = result_.has_value();
  }
  is_over ? rest() : read();
}

/// Ends the call; the first status counts.
void ApplyStreamCall::end(Status status) {
  {
    const std::lock_guard lock(mutex_);
    if (!result_) result_ = std::move(status);
    ++busy_;
  }
  rest();
}

/// Ends one busy operation; the last one finishes a call that is over.
void ApplyStreamCall::rest() {
  Status result;
  {
    const std::lock_guard lock(mutex_);
    if (--busy_ > 0 || !result_ || is_finished_) return;
    is_finished_ = true;
    result = *result_;
  }
  finish(result);
}

void ApplyStreamCall::on_tick(EventLoop::Clock::time_point) {
  Status lasting = scope_.check_may_continue(daemon_.gate);
  if (lasting) return;
  bool is_stuck;
  {
    const std::lock_guard lock(mutex_);
    is_stuck = is_writing_ && result_;
  }
  if (is_stuck) scope_.context().TryCancel();  // only this ends a write in flight
  end(std::move(lasting));
}

}  // namespace heliograph::server
