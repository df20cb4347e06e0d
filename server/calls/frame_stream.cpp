// The mailbox and the chunks of Render. Called by service_render.cpp and the engine.
#include "server/calls/frame_stream.h"

#include <algorithm>

#include "server/calls/render_task.h"
#include "server/convert/error.h"
#include "server/convert/frame.h"

namespace heliograph::server {

std::shared_ptr<FrameStream> FrameStream::start(Daemon& daemon,
                                                grpc::CallbackServerContext& context, Call call) {
  std::shared_ptr<FrameStream> stream(new FrameStream(daemon, context, std::move(call)));
  stream->self_ = stream;
  daemon.stall_monitor.add(stream);
  return stream;
}

FrameStream::FrameStream(Daemon& daemon, grpc::CallbackServerContext& context, Call call)
    : scope_(context, std::move(call)),
      stall_seconds_(double(daemon.config.limits.stall_seconds)),
      cutter_(daemon.config.limits.chunk_bytes, scope_.session(), note_frames(daemon, context)) {}

void FrameStream::expect(const RenderTask& task) {
  headers_ = task.headers;
  finals_left_ = task.job->worlds ? 1 : u32(task.job->cameras.size());
}

void FrameStream::progress(const Progress& progress) {
  {
    const std::lock_guard lock(mutex_);
    if (finals_left_ == 0) {  // done() follows immediately
      if (has_sent_progress_) progress_ = progress;
      return;
    }
    progress_ = progress;
  }
  pump();
}

void FrameStream::frame(std::shared_ptr<const Frame> frame) {
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(frames_, [&](const auto& waiting) {
      return !waiting->final && waiting->index == frame->index;
    });
    if (frame->final) --finals_left_;
    frames_.push_back(std::move(frame));
    if (finals_left_ == 0) return;  // done() follows immediately; the call ends with the last write
  }
  pump();
}

void FrameStream::done(Status status, const Spent&) {
  {
    const std::lock_guard lock(mutex_);
    result_ = std::move(status);
  }
  pump();
}

void FrameStream::OnWriteDone(bool ok) {
  {
    const std::lock_guard lock(mutex_);
    is_writing_ = false;
  }
  if (!ok) scope_.request_stop();  // then the job's done() finishes the call
  pump();
}

void FrameStream::OnDone() {
  end_ticks();
  if (scope_.is_stopped()) cutter_.abandon();
  self_.reset();
}

void FrameStream::on_tick(EventLoop::Clock::time_point now) {
  bool is_stuck;
  {
    const std::lock_guard lock(mutex_);
    is_stuck = is_writing_ && standstill_.is_longer_than(stall_seconds_, now);
  }
  if (is_stuck) scope_.context().TryCancel();
}

/// Starts the next write, or finishes; the only place that does either.
void FrameStream::pump() {
  bool writes, ends;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    if (scope_.is_stopped()) frames_.clear(), cutter_.drop(), progress_.reset();
    writes = is_writing_ = next_part();
    ends = is_finished_ = result_ && (!writes || is_last_part());
    if (writes) standstill_.moved();
  }
  if (!ends) return writes ? StartWrite(&part_) : void();
  const grpc::Status status =
      to_status(scope_.session()->with_shutdown_reason(*result_), scope_.context());
  if (writes)
    StartWriteAndFinish(&part_, {}, status);
  else
    Finish(status);
}

bool FrameStream::is_last_part() const { return cutter_.at_end() && frames_.empty() && !progress_; }

bool FrameStream::next_part() {
  if (cutter_.next(part_)) return true;
  if (!frames_.empty()) {
    cutter_.begin({std::move(frames_.front()), headers_}, part_);
    frames_.pop_front();
    return true;
  }
  if (!progress_) return false;
  *part_.mutable_progress() = to_proto(*progress_);
  progress_.reset();
  has_sent_progress_ = true;
  return true;
}

}  // namespace heliograph::server
