// Point tracks: requests to jobs. Called by Tracks.
#pragma once

#include "server/convert/query.h"

namespace heliograph::server {

struct TrackLimits {
  u64 items = 1u << 20;  // points x times per call
  u64 times = 256;
};

/// Makes the job of a request on a snapshot. INVALID_ARGUMENT, NOT_FOUND, UNIMPLEMENTED,
/// RESOURCE_EXHAUSTED, with the path in the request.
[[nodiscard]] Expected<QueryJob> to_tracks(const v1::TracksRequest& request,
                                           std::shared_ptr<const Snapshot> snapshot,
                                           ArraySource& source, const TrackLimits& limits);

}  // namespace heliograph::server
