// Files on the daemon's machine, for DecodeAsset's server_path: only beneath one folder.
#pragma once

#include <string>

#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

/// An open file, not read yet. The size of a sparse file includes its holes.
struct AssetFile {
  UniqueFd fd;
  u64 size = 0;

  /// Reads the whole file. UNAVAILABLE when it became shorter.
  [[nodiscard]] Expected<BufferPtr> read() const;
};

/// The folder of --asset-root. Thread: any.
class AssetRoot {
 public:
  AssetRoot() = default;  // refuses everything
  [[nodiscard]] static Expected<AssetRoot> open(const std::string& folder);

  /// Opens a regular file of at most `max_bytes`. Links of any kind, devices, pipes and paths that
  /// leave the folder are NOT_FOUND with the same message as a missing file; a larger file is
  /// RESOURCE_EXHAUSTED; without a root, PERMISSION_DENIED.
  [[nodiscard]] Expected<AssetFile> find(const std::string& path, u64 max_bytes) const;

 private:
  explicit AssetRoot(UniqueFd folder) : folder_(std::move(folder)) {}
  UniqueFd folder_;
};

}  // namespace heliograph::server
