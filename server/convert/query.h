// Spatial queries: requests to jobs. Called by Query.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "renderer/frame/query.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

struct QueryLimits {
  u64 items = 1u << 26;  // rays, pixels, points or pairs of one query
};

/// Makes the job of a request on a snapshot. INVALID_ARGUMENT, NOT_FOUND, UNIMPLEMENTED,
/// RESOURCE_EXHAUSTED, with the path in the request.
[[nodiscard]] Expected<QueryJob> to_query(const v1::QueryRequest& request,
                                          std::shared_ptr<const Snapshot> snapshot,
                                          ArraySource& source, const QueryLimits& limits);

}  // namespace heliograph::server
