// A frame as the messages that carry it: its header, then its planes in chunks, cut when they are
// sent. Used by every call that answers with frames.
#pragma once

#include <functional>
#include <memory>

#include "heliograph/v1/render.pb.h"
#include "renderer/engine/frame.h"

namespace heliograph::server {

/// A frame and how its header is made.
struct OutgoingFrame {
  std::shared_ptr<const Frame> frame;
  std::shared_ptr<const std::function<v1::FrameHeader(const Frame&)>> make_header;
};

/// Thread: one at a time.
class FrameCutter {
 public:
  explicit FrameCutter(u64 chunk_bytes) : chunk_bytes_(chunk_bytes) {}

  /// Fills the frame's first part. The one before must have been sent whole.
  void begin(OutgoingFrame outgoing, v1::FramePart& part);
  /// Fills its next part; false when there is none.
  [[nodiscard]] bool next(v1::FramePart& part);
  void drop() { frame_.reset(); }

 private:
  const u64 chunk_bytes_;
  std::shared_ptr<const Frame> frame_;
  u32 plane_ = 0;
  u64 offset_ = 0;  // bytes into that plane
};

}  // namespace heliograph::server
