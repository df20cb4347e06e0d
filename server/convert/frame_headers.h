// Headers of a job's frames. Writing their manifests as JSON takes Protocol Buffers longer than the
// last steps of a small frame, so they are written while the frames are rendered.
#pragma once

#include <map>
#include <mutex>

#include "server/convert/frame.h"

namespace heliograph::server {

/// Makes the headers of one job. Thread: any.
class FrameHeaders {
 public:
  explicit FrameHeaders(FrameContext context) : context_(std::move(context)) {}

  /// Writes the manifests ahead, where the stop rule determines them. Called once the job is
  /// queued, by an otherwise idle thread.
  void write_ahead();
  [[nodiscard]] v1::FrameHeader header(const Frame& frame);
  /// Returns true when the client reads PlaneInfo.buffer.
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
  u32 given_ = 0;                 // cameras whose frame has its header; guarded by mutex_
};

}  // namespace heliograph::server
