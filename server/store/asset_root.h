// Files of the daemon's own machine, for DecodeAsset's server_path: only beneath one folder.
#pragma once

#include <string>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// An open file, of which nothing was read yet. A file with holes has its whole size.
struct AssetFile {
  UniqueFd fd;
  u64 size = 0;

  /// All of it. UNAVAILABLE when it became shorter.
  [[nodiscard]] Expected<BufferPtr> read() const;
};

/// Thread: any.
class AssetRoot {
 public:
  AssetRoot() = default;  // refuses everything
  [[nodiscard]] static Expected<AssetRoot> open(const std::string& folder);

  /// Opens a regular file. Links of any kind, devices, pipes and paths that lead out of the folder
  /// are NOT_FOUND in the same words as a file that is not there; too large is RESOURCE_EXHAUSTED;
  /// without a root, PERMISSION_DENIED.
  [[nodiscard]] Expected<AssetFile> find(const std::string& path, u64 max_bytes) const;

 private:
  explicit AssetRoot(UniqueFd folder) : folder_(std::move(folder)) {}
  UniqueFd folder_;
};

}  // namespace heliograph::server
