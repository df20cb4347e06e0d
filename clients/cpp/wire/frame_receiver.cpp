// Render over a stream of raw messages, whose pixels are never parsed.
#include "wire/frame_receiver.h"

#include "wire/assembly.h"
#include "wire/raw_stream.h"

namespace heliograph::client::wire {

std::vector<Frame> render(const std::shared_ptr<Session>& session, const v1::RenderRequest& request,
                          const RenderOptions::Fields& options) {
  Assembly assembly;
  FinalFrames frames(std::size_t(request.cameras_size()));
  RawStream stream(session, "Render", {options.timeout, options.cancellation});
  stream.send(request, true);
  for (grpc::ByteBuffer part; stream.read(&part); part.Clear()) {
    auto arrived = assembly.add(part, options.progress);
    if (!arrived) continue;
    if (options.on_pass) options.on_pass(arrived->frame);
    frames.add(std::move(*arrived));
  }
  return frames.take();
}

}  // namespace heliograph::client::wire
