// What is in a scene, by name and number. Used by DescribeScene.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/snapshot.h"
#include "server/convert/page.h"

namespace heliograph::server {

void describe_counts(const Snapshot& snapshot, v1::ObjectCounts& counts);
void describe_categories(const Snapshot& snapshot, v1::DescribeSceneReply& reply);
/// A page of the objects whose name matches the glob ("": all, nameless ones too), by kind and in
/// id order.
void describe_objects(const Snapshot& snapshot, const std::string& pattern, Page& page,
                      v1::DescribeSceneReply& reply);
/// Bytes of the tables' rows; chunks that other revisions share are counted here too.
[[nodiscard]] u64 row_bytes(const Snapshot& snapshot);

}  // namespace heliograph::server
