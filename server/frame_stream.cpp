// The mailbox and the chunks of Render. Called by service_render.cpp and the engine.
#include "server/frame_stream.h"

#include <algorithm>

#include "server/convert/error.h"
#include "server/convert/frame.h"

namespace heliograph::server {

std::shared_ptr<FrameStream> FrameStream::start(grpc::CallbackServerContext& context, Call call,
                                                const Limits& limits) {
  std::shared_ptr<FrameStream> stream(
      new FrameStream(context, std::move(call), limits.chunk_bytes));
  stream->self_ = stream;
  return stream;
}

FrameStream::FrameStream(grpc::CallbackServerContext& context, Call call, u64 chunk_bytes)
    : context_(context), call_(std::move(call)), chunk_bytes_(chunk_bytes) {
  on_session_end_.emplace(call_.session()->ended(), [this] { stop_.request_stop(); });
}

void FrameStream::progress(const Progress& progress) {
  {
    const std::lock_guard lock(mutex_);
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
    frames_.push_back(std::move(frame));
  }
  pump();
}

void FrameStream::done(Status status) {
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
  if (!ok) stop_.request_stop();  // the job's done() finishes the call
  pump();
}

void FrameStream::OnDone() {
  on_session_end_.reset();
  self_.reset();
}

/// Starts the next write, or finishes. The one place that does either.
void FrameStream::pump() {
  std::optional<Status> result;
  {
    const std::lock_guard lock(mutex_);
    if (is_writing_ || is_finished_) return;
    const bool is_stopped = stop_.stop_requested();
    if (is_stopped) frames_.clear(), sending_.reset(), progress_.reset();
    if (next_part()) {
      is_writing_ = true;
    } else if (result_) {
      result = result_;
      is_finished_ = true;
    } else {
      return;
    }
  }
  if (!result) return StartWrite(&part_);
  Finish(to_status(*result, context_));
}

bool FrameStream::next_part() {
  if (sending_) {
    cut_chunk();
    return true;
  }
  if (!frames_.empty()) {
    begin_frame(std::move(frames_.front()));
    frames_.pop_front();
    return true;
  }
  if (!progress_) return false;
  *part_.mutable_progress() = to_proto(*progress_);
  progress_.reset();
  return true;
}

void FrameStream::begin_frame(std::shared_ptr<const Frame> frame) {
  *part_.mutable_header() = make_header_(*frame);
  plane_ = 0;
  offset_ = 0;
  if (!frame->planes.empty()) sending_ = std::move(frame);
}

void FrameStream::cut_chunk() {
  *part_.mutable_chunk() = to_chunk(*sending_, plane_, offset_, chunk_bytes_);
  offset_ += part_.chunk().chunk().size();
  if (offset_ < sending_->planes[plane_].pixels.size()) return;
  offset_ = 0;
  if (++plane_ == sending_->planes.size()) sending_.reset();
}

}  // namespace heliograph::server
