// Conversion of frames, columns and progress to messages. Called by Render and Query.
#pragma once

#include <span>

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/job.h"
#include "server/os/trace.h"

namespace heliograph::server {

/// Context of a header: who rendered the frame, and for which request.
struct FrameContext {
  v1::RenderRequest request;
  std::shared_ptr<const RenderJob> job;  // made from the request
  std::string version;                   // of the daemon
  std::string backend;
  std::string cpu_features;
  Trace trace = {};  // of the call; may be empty
};

/// Returns the header of a frame without its manifest; the planes' bytes follow in chunks.
[[nodiscard]] v1::FrameHeader to_header(const Frame& frame, const FrameContext& context);

/// Returns a request that renders the frame again to the same bytes: defaults, times and stop rules
/// are written out. Leaves out an overlay of more than 64 KiB.
[[nodiscard]] v1::RenderRequest request_again(const Frame& frame, const FrameContext& context);
[[nodiscard]] std::string json_of(const v1::RenderRequest& request);
/// Returns the manifest, JSON: that request, who rendered the frame, the hash of its overlay, and
/// the caller's trace, the only part that differs between equal requests.
///
/// request_json   json_of(request_again())
[[nodiscard]] std::string manifest(const Frame& frame, const FrameContext& context,
                                   const std::string& request_json);

[[nodiscard]] v1::DType to_proto(DType type);
[[nodiscard]] v1::PlaneKind plane_kind(Plane plane);
[[nodiscard]] v1::LabelColumn to_proto(const Column& column);
[[nodiscard]] v1::Progress to_proto(const Progress& progress);

/// A plane on the wire: f32 converted to f16 where the request asks for it.
class WirePlane {
 public:
  WirePlane(const PlaneData& plane, bool half) : plane_(plane), half_(half) {}

  [[nodiscard]] bool is_half() const { return half_; }
  [[nodiscard]] u64 size() const { return half_ ? plane_.pixels.size() / 2 : plane_.pixels.size(); }
  /// Returns at most `limit` bytes from `offset` on, and at least one value.
  [[nodiscard]] std::string chunk(u64 offset, u64 limit) const;

 private:
  void round_to_half(u64 offset, std::span<std::byte> out) const;

  const PlaneData& plane_;
  const bool half_;
};

}  // namespace heliograph::server
