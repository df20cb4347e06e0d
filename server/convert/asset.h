// What clients are told about a decoded asset. Called by DecodeAsset.
#pragma once

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

/// Names by kind, in the order of the edits; "" where one has none. `sha256` is the asset's hash.
[[nodiscard]] v1::AssetInfo to_info(const Asset& asset, const vec3& bounds_min,
                                    const vec3& bounds_max);
/// A lone picture, whose texels are the blob of this hash.
[[nodiscard]] v1::AssetInfo to_info(const ImageData& image, bool srgb, const std::string& blob);

}  // namespace heliograph::server
