// A frame as the messages that carry it: its header, then its planes in chunks, cut when they are
// sent, or in buffers that the client maps. Used by every call that answers with frames.
#pragma once

#include <functional>
#include <memory>
#include <mutex>

#include "heliograph/v1/render.pb.h"
#include "renderer/schedule/engine.h"
#include "server/convert/frame_headers.h"
#include "server/session/session.h"

namespace heliograph::server {

/// A frame and who makes its header.
struct OutgoingFrame {
  std::shared_ptr<const Frame> frame;
  std::shared_ptr<FrameHeaders> headers;
};

/// Thread: one at a time, but for provide().
class FrameCutter {
 public:
  /// Called with each frame before its first part is sent.
  using Begun = std::function<void(const std::shared_ptr<const Frame>&)>;

  FrameCutter(u64 chunk_bytes, std::shared_ptr<Session> session, Begun begun)
      : chunk_bytes_(chunk_bytes), session_(std::move(session)), begun_(std::move(begun)) {}

  /// Says where a job's frames are written that it will cut: where the client maps them, on the
  /// heap, for a client that is sent bytes, or on the engine's device, for one that asks for that.
  /// FAILED_PRECONDITION when it asks and cannot be given it.
  [[nodiscard]] Status provide(RenderJob& job, const Engine& engine);
  /// Fills the frame's first part. The one before must have been sent whole.
  void begin(OutgoingFrame outgoing, v1::FramePart& part);
  /// Fills its next part; false when there is none.
  [[nodiscard]] bool next(v1::FramePart& part);
  /// Nothing is left to send of it.
  [[nodiscard]] bool at_end() const { return !frame_; }
  /// Nothing more of it will be sent.
  void drop() { frame_.reset(); }
  /// The client gave up: it may never return what is on its way.
  void abandon();

 private:
  void skip_named();

  const u64 chunk_bytes_;
  const std::shared_ptr<Session> session_;
  const Begun begun_;  // empty: nobody asks
  std::mutex mutex_;
  std::shared_ptr<SharedFrames> shared_;  // once it was asked for memory; guarded by mutex_
  u64 call_ = 0;                          // number of this call there; guarded by mutex_
  std::shared_ptr<const Frame> frame_;
  std::vector<WirePlane> planes_;  // of frame_
  std::vector<bool> is_named_;     // by plane: the header says where it lies
  u32 plane_ = 0;
  u64 offset_ = 0;  // bytes into that plane
};

}  // namespace heliograph::server
