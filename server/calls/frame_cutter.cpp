// Headers, chunks and leases. See frame_cutter.h.
#include "server/calls/frame_cutter.h"

namespace heliograph::server {
namespace {

constexpr u64 kFewestShared = 64 << 10;  // bytes; smaller planes gain nothing from sharing

/// Returns the lease that a plane lies in; null: it travels as bytes.
LeasedPixels* lease_of(const PlaneData& plane, const WirePlane& wire) {
  return wire.is_half() ? nullptr : dynamic_cast<LeasedPixels*>(plane.pixels.memory());
}

/// Fills in a plane's location, and passes its lease to the client.
void name(LeasedPixels& pixels, u64 size, v1::BufferRef& buffer) {
  const Lease& lease = pixels.send();
  buffer.set_buffer(lease.buffer);
  buffer.set_offset(lease.offset);
  buffer.set_size(size);
  buffer.set_generation(lease.generation);
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
  header = outgoing.headers->header(*outgoing.frame);
  if (begun_) begun_(outgoing.frame);
  plane_ = 0;
  offset_ = 0;
  if (outgoing.frame->planes.empty()) return;
  frame_ = std::move(outgoing.frame);
  planes_.clear();
  is_named_.clear();
  for (std::size_t i = 0; i < frame_->planes.size(); ++i) {
    const PlaneData& plane = frame_->planes[i];
    v1::PlaneInfo& info = *header.mutable_planes(int(i));
    planes_.emplace_back(plane, info.dtype() == v1::D_TYPE_F16);
    auto* lease = outgoing.headers->name_buffers() ? lease_of(plane, planes_.back()) : nullptr;
    is_named_.push_back(lease != nullptr);
    if (lease) name(*lease, info.size(), *info.mutable_buffer());
  }
  skip_named();
}

/// Advances to the next plane that needs a chunk.
void FrameCutter::skip_named() {
  while (plane_ < planes_.size() && is_named_[plane_]) ++plane_;
  if (plane_ == planes_.size()) frame_.reset();
}

bool FrameCutter::next(v1::FramePart& part) {
  if (!frame_) return false;
  const WirePlane& plane = planes_[plane_];
  v1::PlaneChunk& chunk = *part.mutable_chunk();
  chunk.Clear();
  chunk.set_frame(frame_->index);
  chunk.set_plane(plane_);
  if (auto* lease = lease_of(frame_->planes[plane_], plane)) {
    name(*lease, plane.size(), *chunk.mutable_buffer());
  } else {
    chunk.set_offset(offset_);
    chunk.set_chunk(plane.chunk(offset_, chunk_bytes_));
    offset_ += chunk.chunk().size();
    if (offset_ < plane.size()) return true;
    offset_ = 0;
  }
  ++plane_;
  skip_named();
  return true;
}

void FrameCutter::abandon() {
  const std::lock_guard lock(mutex_);
  if (shared_) shared_->abandon(call_);
}

}  // namespace heliograph::server
