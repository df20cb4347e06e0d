// The table of assets.
#include "server/store/assets.h"

#include "server/os/hash.h"

namespace heliograph::server {

std::shared_ptr<const StoredAsset> AssetStore::find(std::string_view hash) const {
  const std::lock_guard lock(mutex_);
  const auto found = assets_.find(hash);
  return found == assets_.end() ? nullptr : found->second.lock();
}

std::shared_ptr<const StoredAsset> AssetStore::put(std::shared_ptr<const StoredAsset> asset) {
  const std::lock_guard lock(mutex_);
  std::erase_if(assets_, [](const auto& entry) { return entry.second.expired(); });
  auto& entry = assets_[asset->info.sha256()];
  if (auto present = entry.lock()) return present;
  entry = asset;
  return asset;
}

std::string asset_hash(v1::DecodeAssetRequest request) {
  request.clear_server_path();
  return sha256(serialize(request));
}

}  // namespace heliograph::server
