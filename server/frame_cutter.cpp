// Headers and chunks. See frame_cutter.h.
#include "server/frame_cutter.h"

#include "server/convert/frame.h"

namespace heliograph::server {

void FrameCutter::begin(OutgoingFrame outgoing, v1::FramePart& part) {
  *part.mutable_header() = (*outgoing.make_header)(*outgoing.frame);
  plane_ = 0;
  offset_ = 0;
  if (!outgoing.frame->planes.empty()) frame_ = std::move(outgoing.frame);
}

bool FrameCutter::next(v1::FramePart& part) {
  if (!frame_) return false;
  *part.mutable_chunk() = to_chunk(*frame_, plane_, offset_, chunk_bytes_);
  offset_ += part.chunk().chunk().size();
  if (offset_ < frame_->planes[plane_].pixels.size()) return true;
  offset_ = 0;
  if (++plane_ == frame_->planes.size()) frame_.reset();
  return true;
}

}  // namespace heliograph::server
