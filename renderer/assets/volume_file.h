// A file of grids that is open: what each is, and its values when they are asked for. Made by
// volume_vdb.cpp and volume_nvdb.cpp, used by volume.cpp.
#pragma once

#include <ios>
#include <memory>
#include <new>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/volume_bricks.h"

namespace heliograph::assets {

/// A grid that a file names.
struct FileEntry {
  std::string name;
  u32 channels = 0;      // 1 or 3; 0: no volume can show it
  std::string why = "";  // it cannot be shown, and the remedy
};

/// Calls `work`; what a library throws becomes a refusal that names the grid.
template <class Work>
auto guarded(const std::string& name, const Work& work) {
  try {
    return work();
  } catch (const std::ios_base::failure&) {
    refuse(name, "the file is truncated");
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    refuse(name, error.what());
  }
}

/// Refuses what is malformed in its own words, naming the grid, whatever a library throws.
class VolumeFile {
 public:
  VolumeFile() = default;
  VolumeFile(const VolumeFile&) = delete;
  virtual ~VolumeFile() = default;

  [[nodiscard]] const std::vector<FileEntry>& entries() const { return entries_; }
  using Use = std::function<void(Bricks&, const Bricks::Read&)>;
  /// Calls once, with the bricks of a grid while they can be read.
  virtual void read(std::size_t entry, const Use& use) = 0;

 protected:
  std::vector<FileEntry> entries_;
};

[[nodiscard]] std::unique_ptr<VolumeFile> open_nvdb(std::span<const std::byte> file,
                                                    Budget& budget);
[[nodiscard]] std::unique_ptr<VolumeFile> open_vdb(std::span<const std::byte> file, Budget& budget);
/// "OpenVDB 10.0.1"
[[nodiscard]] std::string openvdb_version();

}  // namespace heliograph::assets
