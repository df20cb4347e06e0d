// What clients are told about a decoded asset. Called by DecodeAsset.
#pragma once

#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

/// Names by kind, in the order of the edits; "" where one has none. `sha256` is the asset's hash.
[[nodiscard]] v1::AssetInfo to_info(const Asset& asset, const vec3& bounds_min,
                                    const vec3& bounds_max);
/// A lone picture, whose texels are the blob of this hash.
[[nodiscard]] v1::AssetInfo to_info(const ImageData& image, bool srgb, const std::string& blob);
/// Pieces of about 1 MiB, at least one, whose merger it is.
[[nodiscard]] std::vector<v1::AssetInfo> cut(const v1::AssetInfo& info);

}  // namespace heliograph::server
