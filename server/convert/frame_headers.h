// The headers of a job's frames. Their manifests are JSON, which takes Protocol Buffers longer than
// a small frame's last steps: they are written while the frames are rendered.
#pragma once

#include <map>
#include <mutex>

#include "server/convert/frame.h"

namespace heliograph::server {

/// Thread: any.
class FrameHeaders {
 public:
  explicit FrameHeaders(FrameContext context) : context_(std::move(context)) {}

  /// Writes what the manifests will say, where the stop rule tells it. Called once the job is
  /// queued, by who has nothing else to do.
  void write_ahead();
  [[nodiscard]] v1::FrameHeader header(const Frame& frame);
  /// The client reads PlaneInfo.buffer.
  [[nodiscard]] bool name_buffers() const { return context_.request.buffers_in_header(); }

 private:
  struct Written {
    std::string request;  // serialised
    std::string json;
  };
  [[nodiscard]] std::string json_again(const Frame& frame);

  const FrameContext context_;
  std::mutex mutex_;
  std::map<u32, Written> ahead_;  // by camera; guarded by mutex_
  u32 given_ = 0;                 // frames of so many cameras have their header; the same
};

}  // namespace heliograph::server
