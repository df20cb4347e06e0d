#include "server/convert/frame_headers.h"

#include <algorithm>
#include <utility>

#include "renderer/frame/frame_header.h"

namespace heliograph::server {

void FrameHeaders::write_ahead() {
  const RenderJob& job = *context_.job;
  const StopRule& stop = job.stop;
  if (job.worlds || stop.seconds > 0 || stop.noise > 0 || stop.adaptive) return;
  for (u32 camera = 0; camera < job.cameras.size(); ++camera) {
    const std::lock_guard lock(mutex_);
    if (camera < given_) continue;
    Frame frame = frame_header(job, camera);
    frame.samples = stop.spp;
    const v1::RenderRequest request = request_again(frame, context_);
    ahead_[camera] = {request.SerializeAsString(), json_of(request)};
  }
}

std::string FrameHeaders::json_again(const Frame& frame) {
  const v1::RenderRequest request = request_again(frame, context_);
  {
    const std::lock_guard lock(mutex_);
    given_ = std::max(given_, frame.index + 1);
    const auto found = ahead_.find(frame.index);
    if (found != ahead_.end() && found->second.request == request.SerializeAsString())
      return std::move(ahead_.extract(found).mapped().json);
  }
  return json_of(request);
}

v1::FrameHeader FrameHeaders::header(const Frame& frame) {
  v1::FrameHeader header = to_header(frame, context_);
  header.set_manifest(manifest(frame, context_, json_again(frame)));
  return header;
}

}  // namespace heliograph::server
