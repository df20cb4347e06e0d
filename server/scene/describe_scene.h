// Lists the objects of a scene by name and number. Used by DescribeScene.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/snapshot.h"
#include "server/convert/page.h"

namespace heliograph::server {

void describe_counts(const Snapshot& snapshot, v1::ObjectCounts& counts);
void describe_categories(const Snapshot& snapshot, v1::DescribeSceneReply& reply);
/// Fills a page with the objects whose name matches the glob ("": all, also unnamed ones), by kind
/// and in id order.
void describe_objects(const Snapshot& snapshot, const std::string& pattern, Page& page,
                      v1::DescribeSceneReply& reply);
/// Returns the bytes of the tables' rows, including chunks shared with other revisions.
[[nodiscard]] u64 row_bytes(const Snapshot& snapshot);

}  // namespace heliograph::server
