// RenderRequest to RenderJob: every number checked, every reference resolved. Called by Render.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/job.h"

namespace heliograph::server {

struct RenderLimits {
  u32 size = 16384;        // pixels per side
  u32 spp = 1u << 20;      // samples per pixel
  double seconds = 86400;  // of a job's stop rule
  u32 max_depth = 1024;    // path edges
  u32 cameras = 1024;      // per request
  u32 label_rows = 1u << 20;
  u32 groups = 64;  // light groups per request
};

/// Makes the job of a request on a snapshot that has the request's overlay applied. Sets no
/// deadline. INVALID_ARGUMENT, NOT_FOUND (a camera), UNIMPLEMENTED (a plane or field that this
/// version lacks), each with its path in the request.
[[nodiscard]] Expected<RenderJob> to_job(const v1::RenderRequest& request,
                                         std::shared_ptr<const Snapshot> snapshot,
                                         const RenderLimits& limits);

/// Converts a plane. UNIMPLEMENTED, with its name, for one that is declared and not built.
[[nodiscard]] Expected<Plane> to_plane(v1::Plane plane);
[[nodiscard]] v1::Plane to_proto(Plane plane);

/// Returns true when an array of a message, or of a nested one, lies in a buffer that its client
/// was lent.
[[nodiscard]] bool names_lent_buffers(const google::protobuf::Message& message);
/// Returns true when an array's bytes are not in the message.
[[nodiscard]] bool has_arrays_elsewhere(const google::protobuf::Message& message);
/// Returns a hash of an overlay's content, never 0. An overlay with lent buffers, whose content may
/// have changed, gets a new number each time.
[[nodiscard]] u64 overlay_hash(const v1::Transaction& overlay);

}  // namespace heliograph::server
