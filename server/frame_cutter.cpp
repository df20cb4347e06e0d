// Headers, chunks and leases. See frame_cutter.h.
#include "server/frame_cutter.h"

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

Status FrameCutter::provide(RenderJob& job, const Engine& engine) {
  const std::lock_guard lock(mutex_);
  if (!shared_ && (shared_ = session_->shared_frames())) call_ = shared_->new_call();
  if (job.on_device && !shared_)
    return fail(Code::kFailedPrecondition, "memory",
                "planes stay on the GPU for a client that maps buffers, on the daemon's own "
                "machine; connect over its Unix socket, or ask for planes on the host");
  if (job.on_device && begun_)
    return fail(Code::kFailedPrecondition, "memory",
                "this daemon records, and recordings have the hashes of frames; ask for planes on "
                "the host, or start it without --record");
  if (!shared_) return {};
  job.memory = [frames = shared_, call = call_, device = job.on_device ? &engine : nullptr](
                   Plane, u64 bytes) -> std::shared_ptr<PixelMemory> {
    const auto source = device ? device->shared_memory() : nullptr;
    if (device ? !source : bytes < kFewestShared) return nullptr;
    auto lease = frames->lease(bytes, call, source);
    return lease ? std::make_shared<LeasedPixels>(frames, *std::move(lease)) : nullptr;
  };
  return {};
}

void FrameCutter::begin(OutgoingFrame outgoing, v1::FramePart& part) {
  v1::FrameHeader& header = *part.mutable_header();
  header = (*outgoing.make_header)(*outgoing.frame);
  if (begun_) begun_(outgoing.frame);
  plane_ = 0;
  offset_ = 0;
  if (outgoing.frame->planes.empty()) return;
  frame_ = std::move(outgoing.frame);
  planes_.clear();
  for (std::size_t i = 0; i < frame_->planes.size(); ++i)
    planes_.emplace_back(frame_->planes[i], header.planes(int(i)).dtype() == v1::D_TYPE_F16);
}

bool FrameCutter::next(v1::FramePart& part) {
  if (!frame_) return false;
  const WirePlane& plane = planes_[plane_];
  auto* leased = dynamic_cast<LeasedPixels*>(frame_->planes[plane_].pixels.memory());
  if (leased && !plane.is_half()) {
    *part.mutable_chunk() = place_of(*frame_, plane_, leased->send());
  } else {
    v1::PlaneChunk& chunk = *part.mutable_chunk();
    chunk.Clear();
    chunk.set_frame(frame_->index);
    chunk.set_plane(plane_);
    chunk.set_offset(offset_);
    chunk.set_chunk(plane.chunk(offset_, chunk_bytes_));
    offset_ += chunk.chunk().size();
    if (offset_ < plane.size()) return true;
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
