// A decoded asset in the reply to clients. Called by DecodeAsset.
#pragma once

#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

/// Returns an asset's names by kind, in the order of the edits; "" for unnamed objects. `sha256` is
/// the asset's hash.
[[nodiscard]] v1::AssetInfo to_info(const Asset& asset, const vec3& bounds_min,
                                    const vec3& bounds_max);
/// Returns the reply for a lone picture, whose texels are the blob of this hash.
[[nodiscard]] v1::AssetInfo to_info(const ImageData& image, bool srgb, const std::string& blob);
/// Splits a reply into pieces of about 1 MiB, at least one; merged, they give the reply again.
[[nodiscard]] std::vector<v1::AssetInfo> cut(const v1::AssetInfo& info);

}  // namespace heliograph::server
