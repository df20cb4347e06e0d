// Headers and chunks. See frame_cutter.h.
#include "server/frame_cutter.h"

#include <cstring>

#include "server/convert/frame.h"

namespace heliograph::server {
namespace {

constexpr u64 kFewestShared = 64 << 10;  // bytes; smaller frames gain nothing

/// Where the next plane starts: aligned for any use of it.
u64 after(const PlaneData& plane, u64 offset) {
  constexpr u64 kAlignment = 64;
  return (offset + plane.pixels.size() + kAlignment - 1) / kAlignment * kAlignment;
}

struct Place {
  u32 frame, plane;
  u64 offset;  // in the buffer
};
void put_place(const Place& place, const Lease& lease, u64 bytes, v1::FramePart& part) {
  v1::PlaneChunk& chunk = *part.mutable_chunk();
  chunk.Clear();
  chunk.set_frame(place.frame);
  chunk.set_plane(place.plane);
  v1::BufferRef& buffer = *chunk.mutable_buffer();
  buffer.set_buffer(lease.buffer);
  buffer.set_offset(place.offset);
  buffer.set_size(bytes);
  buffer.set_generation(lease.generation);
}

}  // namespace

void FrameCutter::begin(OutgoingFrame outgoing, v1::FramePart& part) {
  *part.mutable_header() = (*outgoing.make_header)(*outgoing.frame);
  plane_ = 0;
  offset_ = 0;
  if (outgoing.frame->planes.empty()) return;
  frame_ = std::move(outgoing.frame);
  share();
}

bool FrameCutter::next(v1::FramePart& part) {
  if (!frame_) return false;
  const PlaneData& plane = frame_->planes[plane_];
  if (lease_) {
    put_place({frame_->index, plane_, offset_}, *lease_, plane.pixels.size(), part);
    offset_ = after(plane, offset_);
  } else {
    *part.mutable_chunk() = to_chunk(*frame_, plane_, offset_, chunk_bytes_);
    offset_ += part.chunk().chunk().size();
    if (offset_ < plane.pixels.size()) return true;
    offset_ = 0;
  }
  if (++plane_ == frame_->planes.size()) frame_.reset();
  return true;
}

/// Copies the frame into a buffer of its session, if there is one.
void FrameCutter::share() {
  lease_.reset();
  if (!shared_ && (shared_ = session_->shared_frames())) call_ = shared_->new_call();
  u64 bytes = 0;
  for (const PlaneData& plane : frame_->planes) bytes = after(plane, bytes);
  if (!shared_ || bytes < kFewestShared) return;
  lease_ = shared_->lease(bytes, call_);
  if (!lease_) return;
  u64 offset = 0;
  for (const PlaneData& plane : frame_->planes) {
    std::memcpy(lease_->bytes.data() + offset, plane.pixels.data(), plane.pixels.size());
    offset = after(plane, offset);
  }
}

void FrameCutter::drop() {
  if (frame_ && lease_) shared_->abandon(lease_->buffer);
  frame_.reset();
}

void FrameCutter::abandon() {
  if (shared_) shared_->abandon_all(call_);
}

}  // namespace heliograph::server
