// Frames, columns and progress on their way to the wire. Called by Render and Query.
#pragma once

#include <span>

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/job.h"
#include "server/os/trace.h"

namespace heliograph::server {

/// What a header says besides the frame: who rendered it, and for which request.
struct FrameContext {
  v1::RenderRequest request;
  std::shared_ptr<const RenderJob> job;  // made of the request
  std::string version;                   // of the daemon
  std::string backend;
  std::string cpu_features;
  Trace trace = {};  // of the call, where it has one
};

/// The header of a frame but for its manifest; its planes' bytes follow in chunks.
[[nodiscard]] v1::FrameHeader to_header(const Frame& frame, const FrameContext& context);

/// A request that renders the frame again to the same bytes: everything that was left to defaults,
/// to time or to noise is written out. An overlay of more than 64 KiB is left out.
[[nodiscard]] v1::RenderRequest request_again(const Frame& frame, const FrameContext& context);
[[nodiscard]] std::string json_of(const v1::RenderRequest& request);
/// JSON of that request, who rendered the frame, the hash of its overlay, and the caller's trace,
/// which is the one thing that differs between equal requests.
///
/// request_json   json_of(request_again())
[[nodiscard]] std::string manifest(const Frame& frame, const FrameContext& context,
                                   const std::string& request_json);

[[nodiscard]] v1::DType to_proto(DType type);
[[nodiscard]] v1::PlaneKind plane_kind(Plane plane);
[[nodiscard]] v1::LabelColumn to_proto(const Column& column);
[[nodiscard]] v1::Progress to_proto(const Progress& progress);

/// A plane as it travels: f32 as f16 where the request wants that.
class WirePlane {
 public:
  WirePlane(const PlaneData& plane, bool half) : plane_(plane), half_(half) {}

  [[nodiscard]] bool is_half() const { return half_; }
  [[nodiscard]] u64 size() const { return half_ ? plane_.pixels.size() / 2 : plane_.pixels.size(); }
  /// At most `limit` bytes from `offset` on, at least one pixel's number.
  [[nodiscard]] std::string chunk(u64 offset, u64 limit) const;

 private:
  void round_to_half(u64 offset, std::span<std::byte> out) const;

  const PlaneData& plane_;
  const bool half_;
};

}  // namespace heliograph::server
