// Headers, chunks and leases. See frame_cutter.h.
#include "server/frame_cutter.h"

#include "server/convert/frame.h"

namespace heliograph::server {
namespace {

constexpr u64 kFewestShared = 64 << 10;  // bytes; smaller planes gain nothing

/// The chunk that names where a plane lies.
v1::PlaneChunk place_of(const Frame& frame, u32 plane, const Lease& lease) {
  v1::PlaneChunk chunk;
  chunk.set_frame(frame.index);
  chunk.set_plane(plane);
  v1::BufferRef& buffer = *chunk.mutable_buffer();
  buffer.set_buffer(lease.buffer);
  buffer.set_size(frame.planes[plane].pixels.size());
  buffer.set_generation(lease.generation);
  return chunk;
}

}  // namespace

PixelAllocator FrameCutter::memory() {
  const std::lock_guard lock(mutex_);
  if (!shared_ && (shared_ = session_->shared_frames())) call_ = shared_->new_call();
  if (!shared_) return {};
  return [frames = shared_, call = call_](u64 bytes) -> std::shared_ptr<PixelMemory> {
    if (bytes < kFewestShared) return nullptr;
    auto lease = frames->lease(bytes, call);
    return lease ? std::make_shared<LeasedPixels>(frames, *std::move(lease)) : nullptr;
  };
}

void FrameCutter::begin(OutgoingFrame outgoing, v1::FramePart& part) {
  *part.mutable_header() = (*outgoing.make_header)(*outgoing.frame);
  if (begun_) begun_(outgoing.frame);
  plane_ = 0;
  offset_ = 0;
  if (!outgoing.frame->planes.empty()) frame_ = std::move(outgoing.frame);
}

bool FrameCutter::next(v1::FramePart& part) {
  if (!frame_) return false;
  const Pixels& pixels = frame_->planes[plane_].pixels;
  if (auto* leased = dynamic_cast<LeasedPixels*>(pixels.memory())) {
    *part.mutable_chunk() = place_of(*frame_, plane_, leased->send());
  } else {
    *part.mutable_chunk() = to_chunk(*frame_, plane_, offset_, chunk_bytes_);
    offset_ += part.chunk().chunk().size();
    if (offset_ < pixels.size()) return true;
    offset_ = 0;
  }
  if (++plane_ == frame_->planes.size()) frame_.reset();
  return true;
}

void FrameCutter::abandon() {
  const std::lock_guard lock(mutex_);
  if (shared_) shared_->abandon(call_);
}

}  // namespace heliograph::server
