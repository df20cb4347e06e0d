// RenderRequest to RenderJob: every number checked, every reference resolved. Called by Render.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/job.h"

namespace heliograph::server {

struct RenderLimits {
  u32 size = 16384;        // of each side, pixels
  u32 spp = 1u << 20;      // samples a pixel
  double seconds = 86400;  // of one job's stop rule
  u32 max_depth = 1024;    // path edges
  u32 cameras = 1024;      // of one request
  u32 label_rows = 1u << 20;
  u32 groups = 64;  // light groups of one request
};

/// The job of a request on a snapshot, to which the request's overlay is applied already. Its
/// deadline is not set.
///
/// Fails with INVALID_ARGUMENT, NOT_FOUND (a camera), UNIMPLEMENTED (a plane or a field that this
/// version lacks), each with its path in the request.
[[nodiscard]] Expected<RenderJob> to_job(const v1::RenderRequest& request,
                                         std::shared_ptr<const Snapshot> snapshot,
                                         const RenderLimits& limits);

/// UNIMPLEMENTED, naming the plane, for one that is declared and not built.
[[nodiscard]] Expected<Plane> to_plane(v1::Plane plane);
[[nodiscard]] v1::Plane to_proto(Plane plane);

/// Whether an array of a message, or of one in it, lies in a buffer that its client was lent.
[[nodiscard]] bool names_lent_buffers(const google::protobuf::Message& message);
/// Whether the bytes of such an array are not in the message.
[[nodiscard]] bool has_arrays_elsewhere(const google::protobuf::Message& message);
/// Names an overlay by its content, but one with lent buffers, which may hold anything by now,
/// another time by another number; never 0.
[[nodiscard]] u64 overlay_hash(const v1::Transaction& overlay);

}  // namespace heliograph::server
