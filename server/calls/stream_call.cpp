// Settings, revisions, credits and frames. See stream_call.h.
#include "server/calls/stream_call.h"

#include <atomic>
#include <set>
#include <utility>

#include "server/convert/error.h"
#include "server/convert/fields.h"
#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

/// Returns a scheduling line of its own for a stream, so that its endless refinement leaves room
/// for the session's other jobs.
u64 next_line() {
  static std::atomic<u64> last = 0;
  return ++last;
}

}  // namespace

/// One job of the stream, which can be stopped alone.
class StreamCall::Job final : public JobSink, public std::enable_shared_from_this<Job> {
 public:
  Job(std::shared_ptr<StreamCall> call, Settings settings)
      : call_(std::move(call)),
        settings_(std::move(settings)),
        on_stop_(call_->scope_.stop(), [this] { stop_.request_stop(); }) {}

  /// Starts the job. May take long: runs on the work pool.
  void start() {
    if (auto started = submit_job(); !started) done(started, {});
  }
  void stop() { stop_.request_stop(); }
  /// Returns true once every camera has given a frame.
  [[nodiscard]] bool has_shown_all() const { return has_shown_all_; }

  void progress(const Progress&) override {}
  void frame(std::shared_ptr<const Frame> frame) override {
    shown_.insert(frame->index);
    has_shown_all_ = shown_.size() == std::size_t(settings_->cameras_size());
    call_->on_frame({std::move(frame), headers_});
  }
  void done(Status status, const Spent&) override {
    // A job stopped in favour of a newer one did not fail.
    if (stop_.stop_requested() && !call_->scope_.is_stopped()) status = {};
    call_->on_done(std::move(status));
  }

 private:
  Status submit_job() {
    if (settings_->has_worlds())
      return fail(Code::kInvalidArgument, "settings.worlds",
                  "has no place in a Stream, which shows one scene; use Render or RenderBatch");
    HELIO_TRY(call_->follow(settings_->scene()));
    const CallScope& scope = call_->scope_;
    auto task = to_task(call_->daemon_, *scope.session(), *settings_, record_of(scope.context()));
    if (!task) return std::unexpected(std::move(task).error().at("settings"));
    HELIO_CHECK(task->charge(settings_->ByteSizeLong()), "settings");
    headers_ = task->headers;
    task->job->origin.session ^= call_->line_;
    if (auto provided = call_->cutter_.provide(*task->job, *task->engine); !provided)
      return std::unexpected(std::move(provided).error().at("settings"));
    {
      const std::lock_guard lock(call_->mutex_);
      call_->shown_ = task->job->snapshot->revision;
    }
    return submit(call_->daemon_, *task, shared_from_this(), stop_.get_token());
  }

  std::shared_ptr<StreamCall> call_;
  const Settings settings_;
  std::stop_source stop_;
  std::stop_callback<std::function<void()>> on_stop_;
  std::shared_ptr<FrameHeaders> headers_;
  std::set<u32> shown_;
  std::atomic<bool> has_shown_all_ = false;
};

StreamCall* StreamCall::start(Daemon& daemon, grpc::CallbackServerContext& context, Call call,
                              Charge counted) {
  std::shared_ptr<StreamCall> made(new StreamCall(daemon, context, std::move(call)));
  made->self_ = made;
  made->counted_ = std::move(counted);
  made->pending_charge_ = Charge::none(made->scope_.session()->tenant()->ledger.bytes);
  daemon.stall_monitor.add(made);
  made->StartSendInitialMetadata();
  made->StartRead(&made->request_);
  return made.get();
}

StreamCall::StreamCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call)
    : daemon_(daemon),
      scope_(context, std::move(call)),
      line_(next_line()),
      cutter_(daemon.config.limits.chunk_bytes, scope_.session(), note_frames(daemon, context)) {}

// ---------------------------------------------------------------- what the client sends

void StreamCall::OnReadDone(bool ok) {
  Status taken;
  if (ok) taken = take(std::exchange(request_, {}));
  if (ok && taken) {
    StartRead(&request_);
  } else {
    const std::lock_guard lock(mutex_);
    client_half_closed_ = true;
    if (!taken) close(std::move(taken));
  }
  advance();
}

Status StreamCall::take(v1::StreamRequest request) {
  HELIO_TRY(check_own_fields(request));
  const std::lock_guard lock(mutex_);
  if (!has_begun_) HELIO_TRY(begin(request));
  HELIO_TRY(check_credits(request.credits() + u64(credits_), daemon_.config.limits));
  credits_ += request.credits();
  standstill_.moved();
  if (!request.has_settings()) return {};
  return add(std::move(*request.mutable_settings()));
}

Status StreamCall::begin(const v1::StreamRequest& first) {
  if (!first.has_settings())
    return fail(Code::kInvalidArgument, "settings", "is missing; the first message has it");
  is_lossless_ = first.policy() == v1::StreamRequest::POLICY_LOSSLESS;
  if (first.credits() == 0) credits_ = kDefaultCredits;
  has_begun_ = true;
  return {};
}

Status StreamCall::add(v1::RenderRequest settings) {
  if (is_lossless_ && settings.progressive())
    return fail(Code::kInvalidArgument, "settings.progressive",
                "a lossless stream sends final frames; leave it out, or use the policy latest");
  if (!is_lossless_) pending_.clear(), pending_bytes_ = 0;
  pending_bytes_ += settings.ByteSizeLong();
  HELIO_TRY(check_waiting(pending_bytes_, daemon_.config.limits,
                          {"settings", "more settings", "send the next ones when a frame came"}));
  HELIO_TRY(pending_charge_.resize(charged(pending_bytes_)));
  pending_.push_back(std::make_shared<const v1::RenderRequest>(std::move(settings)));
  return {};
}

// ---------------------------------------------------------------- jobs

bool StreamCall::has_news() const {
  if (!pending_.empty() || is_refused_) return true;
  return settings_ && !settings_->has_revision() && head_ > shown_ && !client_half_closed_;
}

void StreamCall::advance() {
  std::shared_ptr<Job> started;
  {
    const std::lock_guard lock(mutex_);
    if (!job_)
      started = next_job();
    else if (!is_lossless_ && has_news() && job_->has_shown_all())
      job_->stop();
  }
  if (started) {
    const u64 tenant = scope_.session()->tenant()->id;
    if (auto posted = daemon_.pool.post(tenant, [started] { started->start(); }); !posted)
      started->done(posted, {});
  }
  pump();
}

std::shared_ptr<StreamCall::Job> StreamCall::next_job() {
  if (result_ || scope_.is_stopped() || !has_news()) return nullptr;
  if (!frames_.empty() || (credits_ == 0 && !client_half_closed_)) return nullptr;
  if (is_refused_ && EventLoop::Clock::now() < retry_at_) return nullptr;
  is_refused_ = false;
  if (!pending_.empty()) {
    settings_ = std::move(pending_.front());
    pending_.pop_front();
    pending_bytes_ -= settings_->ByteSizeLong();
    [[maybe_unused]] const auto given_back = pending_charge_.resize(charged(pending_bytes_));
  }
  job_ = std::make_shared<Job>(shared_from_this(), settings_);
  return job_;
}

/// Subscribes to the scene's revisions.
Status StreamCall::follow(u64 scene) {
  const auto entry = daemon_.scenes.find(scene, *scope_.session());
  if (!entry) return std::unexpected(Error(entry.error()).at("settings"));
  {
    const std::lock_guard lock(mutex_);
    if (scene == scene_) return {};
  }
  auto watch = (*entry)->watch([weak = weak_from_this()](Revision revision) {
    if (const auto call = weak.lock()) call->on_revision(revision);
  });
  const std::lock_guard lock(mutex_);
  head_ = 0;
  scene_ = scene;
  watch_.swap(watch);
  return {};
}

void StreamCall::on_revision(Revision revision) {
  {
    const std::lock_guard lock(mutex_);
    head_ = std::max(head_, revision);
  }
  advance();
}

void StreamCall::on_frame(OutgoingFrame frame) {
  {
    const std::lock_guard lock(mutex_);
    if (!is_waited_for()) standstill_.moved();
    if (!is_lossless_)
      std::erase_if(frames_, [&](const OutgoingFrame& waiting) {
        return waiting.frame->index == frame.frame->index;
      });
    frames_.push_back(std::move(frame));
  }
  advance();
}

void StreamCall::on_done(Status status) {
  {
    const std::lock_guard lock(mutex_);
    job_.reset();
    if (!status && status.error().retry_seconds > 0) {
      is_refused_ = true;
      retry_at_ = EventLoop::Clock::now() +
                  std::chrono::duration_cast<EventLoop::Clock::duration>(
                      std::chrono::duration<double>(status.error().retry_seconds));
    } else if (!status) {
      close(std::move(status));
    }
  }
  advance();
}

// ---------------------------------------------------------------- what the client gets

/// Starts the next write, or finishes; the only place that does either.
void StreamCall::pump() {
  Status result;
  bool is_part;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    if (scope_.is_stopped()) close(fail(Code::kCancelled, "", "cancelled by the client"));
    if (result_) frames_.clear(), cutter_.drop();
    is_part = next_part();
    const bool is_over =
        !job_ && (result_ || (client_half_closed_ && !has_news() && frames_.empty()));
    if (!is_part && !is_over) return;
    (is_part ? is_writing_ : is_finished_) = true;
    if (is_finished_) watch_.reset();
    if (result_) result = *result_;
  }
  if (is_part) return StartWrite(&part_);
  Finish(to_status(scope_.session()->with_shutdown_reason(result), scope_.context()));
}

bool StreamCall::next_part() {
  if (cutter_.next(part_)) return true;
  if (frames_.empty() || (credits_ == 0 && !client_half_closed_)) return false;
  cutter_.begin(std::move(frames_.front()), part_);
  frames_.pop_front();
  if (credits_ > 0) --credits_;
  return true;
}

void StreamCall::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
    standstill_.moved();
  }
  if (!ok) scope_.request_stop();
  advance();
}

void StreamCall::OnCancel() {
  scope_.request_stop();
  pump();
}

/// Ends the call and its job; the first status counts.
void StreamCall::close(Status status) {
  if (!result_) result_ = std::move(status);
  scope_.request_stop();
}

void StreamCall::OnDone() {
  end_ticks();
  if (scope_.is_stopped()) cutter_.abandon();
  self_.reset();
}

void StreamCall::on_tick(EventLoop::Clock::time_point now) {
  const double limit = double(daemon_.config.limits.stall_seconds);
  Status lasting = scope_.check_may_continue(daemon_.gate);
  bool is_stuck;
  u64 scene;
  {
    const std::lock_guard lock(mutex_);
    const bool is_stalled = is_waited_for() && standstill_.is_longer_than(limit, now);
    is_stuck = is_stalled && is_writing_;
    scene = scene_;
    if (!lasting)
      close(std::move(lasting));
    else if (is_stalled)
      close(fail(Code::kResourceExhausted, "credits",
                 fmt::format("the reader took nothing for {} s; read faster, return credits, or "
                             "open the stream when it is needed (limit stall_seconds)",
                             limit)));
  }
  if (scene != 0)
    if (const auto found = daemon_.scenes.find(scene, *scope_.session()); !found) {
      const std::lock_guard lock(mutex_);
      close(std::unexpected(found.error()));
    }
  if (is_stuck) scope_.context().TryCancel();  // only this ends a write in flight
  advance();
}

}  // namespace heliograph::server
