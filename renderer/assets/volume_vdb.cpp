// .vdb through OpenVDB. docs/decisions/048 names the part of it that is linked.
#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>
#include <openvdb/openvdb.h>

#include <algorithm>
#include <array>
#include <mutex>
#include <spanstream>

#include "renderer/assets/bundle.h"
#include "renderer/assets/volume_file.h"
#include "renderer/assets/volume_trees.h"

namespace heliograph::assets {
namespace {

namespace vdb = openvdb;

constexpr i32 kMostGrids = 4096;

template <class Metadata>
struct RegisterMetadata {
  void operator()() const { Metadata::registerType(); }
};
template <class Map>
struct RegisterMap {
  void operator()() const { Map::registerMap(); }
};
template <class Grid>
struct RegisterGrid {
  void operator()() const { Grid::registerGrid(); }
};

/// The types that are read, and no others: points would bring a third of the library.
void register_types() {
  static std::once_flag once;
  std::call_once(once, [] {
    vdb::MetaTypes::Remove<vdb::io::DelayedLoadMetadata>::foreach<RegisterMetadata>();
    vdb::MapTypes::foreach<RegisterMap>();
    ShownGrids::foreach<RegisterGrid>();
  });
}

/// Values that no volume shows, and what to do about them.
std::string why_not(std::string_view type) {
  if (type.find("ptdataidx") != type.npos || type.find("ptidx") != type.npos)
    return "points: turn them into a density in the program that wrote them";
  return "values of type " + std::string(type);
}

/// Reads the grids of a file one by one.
class VdbFile final : public VolumeFile, private vdb::io::Archive {
 public:
  VdbFile(std::span<const std::byte> bytes, Budget& budget)
      : size_(i64(bytes.size())),
        stream_(std::span(reinterpret_cast<const char*>(bytes.data()), bytes.size())),
        budget_(budget) {
    register_types();
    stream_.exceptions(std::ios::eofbit | std::ios::failbit | std::ios::badbit);
    guarded("header", [&] { read_header(); });
    for (i32 left = guarded("header", [&] { return count(); }); left > 0; --left) add_entry();
  }

  void read(std::size_t entry, const Use& use) override {
    guarded(entries_[entry].name, [&] {
      load(entry);
      const vdb::GridBase::Ptr grid = has_instances_ ? grids_[entry] : std::move(grids_[entry]);
      use_bricks(*grid, entries_[entry].name, budget_, use);
    });
  }

 private:
  void read_header() {
    readHeader(stream_);
    if (fileVersion() > vdb::OPENVDB_FILE_VERSION)
      refuse_unimplemented("header", fmt::format("VDB version {}; up to {} is read", fileVersion(),
                                                 vdb::OPENVDB_FILE_VERSION));
    metadata_->setSeekable(true);
    vdb::io::setStreamMetadataPtr(stream_, metadata_, false);
    setFormatVersion(stream_);
    setLibraryVersion(stream_);
    setDataCompression(stream_);
    vdb::MetaMap().readMeta(stream_);
  }

  i32 count() {
    const i32 count = readGridCount(stream_);
    if (count < 0 || count > kMostGrids) refuse("header", fmt::format("claims {} grids", count));
    if (count == 0) refuse("header", "the file has no grids");
    return count;
  }

  /// A stream is read as it comes: nothing in it marks where its grids end.
  void add_entry() {
    vdb::io::GridDescriptor& at = descriptors_.emplace_back();
    guarded("header", [&] { add_descriptor(at); });
    const std::string& name = entries_.back().name;
    if (inputHasGridOffsets()) {
      if (at.getGridPos() < 0 || at.getEndPos() < at.getGridPos() || at.getEndPos() > size_)
        refuse(name, "a grid leaves the file");
      at.seekToEnd(stream_);
    } else if (grids_.back()) {
      guarded(name, [&] { read_values(descriptors_.size() - 1); });
    } else {
      refuse_unimplemented(name, "in a VDB stream without offsets, " + entries_.back().why);
    }
  }

  void add_descriptor(vdb::io::GridDescriptor& at) {
    vdb::GridBase::Ptr grid;
    std::string why;
    try {
      grid = at.read(stream_);
    } catch (const vdb::LookupError&) {
      why = why_not(at.gridType());
      skip_offsets(at);
    }
    entries_.push_back({.name = clean_name(at.gridName(), "grid"),
                        .channels = grid ? channels_of(*grid) : 0,
                        .why = why});
    grids_.push_back(std::move(grid));
    is_read_.push_back(false);
    has_instances_ |= at.isInstance();
  }

  /// Skips what the library leaves unread of a grid whose type it does not know.
  void skip_offsets(vdb::io::GridDescriptor& at) {
    std::array<i64, 3> offsets{};
    stream_.read(reinterpret_cast<char*>(offsets.data()), sizeof offsets);
    at.setGridPos(offsets[0]);
    at.setBlockPos(offsets[1]);
    at.setEndPos(offsets[2]);
  }

  void read_values(std::size_t entry) {
    is_read_[entry] = true;
    readGrid(grids_[entry], descriptors_[entry], stream_);
  }

  /// Reads the grid unless it was; an instance shares the tree of another.
  void load(std::size_t entry) {
    const vdb::io::GridDescriptor& at = descriptors_[entry];
    if (!is_read_[entry]) {
      at.seekToGrid(stream_);
      read_values(entry);
    }
    if (!at.isInstance()) return;
    const auto parent = std::ranges::find(descriptors_, at.instanceParentName(),
                                          &vdb::io::GridDescriptor::uniqueName);
    if (parent == descriptors_.end() || parent->isInstance())
      refuse(entries_[entry].name, "shares the tree of a grid that is not there");
    const auto of = std::size_t(parent - descriptors_.begin());
    if (!grids_[of]) refuse(entries_[entry].name, "shares the tree of a grid that is not read");
    load(of);
    grids_[entry]->setTree(grids_[of]->baseTreePtr());
  }

  const i64 size_;
  std::ispanstream stream_;
  Budget& budget_;
  vdb::io::StreamMetadata::Ptr metadata_ = std::make_shared<vdb::io::StreamMetadata>();
  std::vector<vdb::io::GridDescriptor> descriptors_;
  std::vector<vdb::GridBase::Ptr> grids_;  // null: of a type that is not read
  std::vector<bool> is_read_;
  bool has_instances_ = false;
};

}  // namespace

std::unique_ptr<VolumeFile> open_vdb(std::span<const std::byte> file, Budget& budget) {
  return std::make_unique<VdbFile>(file, budget);
}

std::string openvdb_version() { return "OpenVDB " OPENVDB_LIBRARY_VERSION_STRING; }

}  // namespace heliograph::assets
