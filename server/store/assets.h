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
  BufferPtr texels;                    // of a picture
  v1::AssetInfo info;
  u64 bytes = 0;  // that it keeps alive; its arrays' charge is with them
};

/// The assets alive, by hash. It owns none: sessions do.
/// Thread: any; one mutex, held for a look-up.
class AssetStore {
 public:
  /// The asset of this hash, or null.
  [[nodiscard]] std::shared_ptr<const StoredAsset> find(std::string_view hash) const;
  /// The one that stands for this hash from now on: `asset`, or one that was there before.
  [[nodiscard]] std::shared_ptr<const StoredAsset> put(std::shared_ptr<const StoredAsset> asset);

 private:
  mutable std::mutex mutex_;
  std::map<std::string, std::weak_ptr<const StoredAsset>, std::less<>> assets_;
};

/// Names what a request decodes to: its files' paths and hashes and its options. `server_path` does
/// not count, so the caller lists the files it read instead.
[[nodiscard]] std::string asset_hash(v1::DecodeAssetRequest request);

}  // namespace heliograph::server
