// What is in a scene, by name and number. Used by DescribeScene.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/snapshot.h"

namespace heliograph::server {

/// Counts by kind and categories, always.
void describe_counts(const Snapshot& snapshot, v1::DescribeSceneReply& reply);
/// Objects whose name matches the glob ("": all, nameless ones too), by kind and in id order.
void describe_objects(const Snapshot& snapshot, const std::string& pattern,
                      v1::DescribeSceneReply& reply);
/// Bytes of the tables' rows; chunks that other revisions share are counted here too.
[[nodiscard]] u64 row_bytes(const Snapshot& snapshot);

}  // namespace heliograph::server
