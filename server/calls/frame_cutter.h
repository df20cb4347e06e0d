// Splits a frame into messages: its header, then its planes in chunks, cut as they are sent, or in
// buffers that the client maps. Used by every call that replies with frames.
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "heliograph/v1/render.pb.h"
#include "renderer/schedule/engine.h"
#include "server/convert/frame_headers.h"
#include "server/session/session.h"

namespace heliograph::server {

/// A frame and the maker of its header.
struct OutgoingFrame {
  std::shared_ptr<const Frame> frame;
  std::shared_ptr<FrameHeaders> headers;
};

/// Cuts the frames of one call. Thread: one at a time; provide(): any.
class FrameCutter {
 public:
  /// Called with each frame before its first part is cut.
  using Begun = std::function<void(const std::shared_ptr<const Frame>&)>;

  FrameCutter(u64 chunk_bytes, std::shared_ptr<Session> session, Begun begun)
      : chunk_bytes_(chunk_bytes), session_(std::move(session)), begun_(std::move(begun)) {}

  /// Chooses where a job's frames are written: in buffers that the client maps, on the heap for
  /// clients that receive bytes, or on the engine's device where the request asks for that.
  /// FAILED_PRECONDITION when it does and cannot have it.
  [[nodiscard]] Status provide(RenderJob& job, const Engine& engine);
  /// Fills the frame's first part. The previous frame must have been cut completely.
  void begin(OutgoingFrame outgoing, v1::FramePart& part);
  /// Fills the next part; false when there is none.
  [[nodiscard]] bool next(v1::FramePart& part);
  /// Returns true when no part is left.
  [[nodiscard]] bool at_end() const { return !frame_; }
  /// Drops the rest of the frame.
  void drop() { frame_.reset(); }
  /// Abandons the call's leases: the client gave up and may never return those in flight.
  void abandon();

 private:
  void skip_named();

  const u64 chunk_bytes_;
  const std::shared_ptr<Session> session_;
  const Begun begun_;  // may be empty
  std::mutex mutex_;
  std::shared_ptr<SharedFrames> shared_;  // set once memory was requested; guarded by mutex_
  u64 call_ = 0;                          // number of this call in shared_; guarded by mutex_
  std::shared_ptr<const Frame> frame_;
  std::vector<WirePlane> planes_;  // of frame_
  std::vector<bool> is_named_;     // by plane: the header has its location
  u32 plane_ = 0;
  u64 offset_ = 0;  // bytes into that plane
};

}  // namespace heliograph::server
