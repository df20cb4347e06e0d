// A frame as the messages that carry it: its header, then its planes in chunks, cut when they are
// sent, or in a buffer that the client maps. Used by every call that answers with frames.
#pragma once

#include <functional>
#include <memory>

#include "heliograph/v1/render.pb.h"
#include "renderer/engine/frame.h"
#include "server/session.h"

namespace heliograph::server {

/// A frame and how its header is made.
struct OutgoingFrame {
  std::shared_ptr<const Frame> frame;
  std::shared_ptr<const std::function<v1::FrameHeader(const Frame&)>> make_header;
};

/// Thread: one at a time.
class FrameCutter {
 public:
  FrameCutter(u64 chunk_bytes, std::shared_ptr<Session> session)
      : chunk_bytes_(chunk_bytes), session_(std::move(session)) {}

  /// Fills the frame's first part. The one before must have been sent whole.
  void begin(OutgoingFrame outgoing, v1::FramePart& part);
  /// Fills its next part; false when there is none.
  [[nodiscard]] bool next(v1::FramePart& part);
  /// Nothing more of it will be sent.
  void drop();
  /// The client gave up: it may never return what is on its way.
  void abandon();

 private:
  void share();

  const u64 chunk_bytes_;
  const std::shared_ptr<Session> session_;
  std::shared_ptr<SharedFrames> shared_;  // once a frame went there
  u64 call_ = 0;                          // number of this call there
  std::optional<Lease> lease_;            // of frame_
  std::shared_ptr<const Frame> frame_;
  u32 plane_ = 0;
  u64 offset_ = 0;  // bytes into that plane, or into the buffer
};

}  // namespace heliograph::server
