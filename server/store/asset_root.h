// Files of the daemon's own machine, for DecodeAsset's server_path: only beneath one folder.
#pragma once

#include <string>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// Thread: any.
class AssetRoot {
 public:
  AssetRoot() = default;  // refuses everything
  [[nodiscard]] static Expected<AssetRoot> open(const std::string& folder);

  /// Reads a regular file whole. Links of any kind, devices, pipes and paths that lead out of the
  /// folder are NOT_FOUND in the same words as a file that is not there; too large is
  /// RESOURCE_EXHAUSTED; without a root, PERMISSION_DENIED.
  [[nodiscard]] Expected<BufferPtr> read(const std::string& path, u64 max_bytes) const;

 private:
  explicit AssetRoot(UniqueFd folder) : folder_(std::move(folder)) {}
  UniqueFd folder_;
};

}  // namespace heliograph::server
