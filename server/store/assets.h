// Decoded assets of a tenant, found by the hash of their bundle. Used by DecodeAsset and by
// sessions.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/transaction.h"
#include "server/store/blobs.h"

namespace heliograph::server {

/// A decoded bundle: a model, or a lone picture whose texels are a blob.
struct StoredAsset {
  std::shared_ptr<const Asset> asset;  // null for a picture
  BufferPtr texels;                    // texels of a picture
  v1::AssetInfo info;
  u64 bytes = 0;  // that it keeps alive; charged by its arrays
};

/// The live assets by hash. Owns none: sessions do. Thread: any; one mutex, held for a lookup.
class AssetStore {
 public:
  /// Returns the asset of this hash, or null.
  [[nodiscard]] std::shared_ptr<const StoredAsset> find(std::string_view hash) const;
  /// Adds an asset, unless one of its hash is alive. Returns the one that is kept.
  [[nodiscard]] std::shared_ptr<const StoredAsset> put(std::shared_ptr<const StoredAsset> asset);

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::weak_ptr<const StoredAsset>, std::less<>> assets_;
};

/// Returns the hash of a decode: of the files' paths and hashes, and of the options. `server_path`
/// does not count, so the caller lists the files it read instead.
[[nodiscard]] std::string asset_hash(v1::DecodeAssetRequest request);

}  // namespace heliograph::server
