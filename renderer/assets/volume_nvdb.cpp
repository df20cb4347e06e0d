// .nvdb through NanoVDB's headers. They trust a file's places within it, so a tree is
// walked here, each node checked to be inside of its grid; what a node holds, they read.
#include <nanovdb/NanoVDB.h>
#include <nanovdb/util/GridHandle.h>
#include <nanovdb/util/IO.h>

#include <algorithm>
#include <spanstream>

#include "renderer/assets/bundle.h"
#include "renderer/assets/volume_file.h"

namespace heliograph::assets {
namespace {

using nanovdb::GridType;
namespace io = nanovdb::io;

constexpr u64 kFileMagic = 0x324244566f6e614eull;  // "NanoVDB2", of files since 32.6
constexpr u32 kMajor = NANOVDB_MAJOR_VERSION_NUMBER;
constexpr u32 kLongestName = 1 << 16;

/// The nodes of one grid.
template <class Build>
class Nodes {
 public:
  using Root = typename nanovdb::NanoRoot<Build>::DataType;
  using Upper = typename nanovdb::NanoUpper<Build>::DataType;
  using Lower = typename nanovdb::NanoLower<Build>::DataType;
  using Leaf = typename nanovdb::NanoLeaf<Build>::DataType;

  Nodes(std::span<const u8> bytes, std::string name) : bytes_(bytes), name_(std::move(name)) {}

  [[nodiscard]] const Root& root() const {
    const auto& tree = at<nanovdb::TreeData<3>>(bytes_.data(), sizeof(nanovdb::GridData));
    const auto& root = at<Root>(&tree, i64(tree.mNodeOffset[3]));
    check(&root, i64(sizeof(Root)), root.mTableSize * sizeof(typename Root::Tile));
    return root;
  }

  void gather(Bricks& bricks) const {
    const Root& top = root();
    for (u32 i = 0; i < top.mTableSize; ++i) {
      const auto& tile = *top.tile(i);
      const ivec3 origin(tile.origin()[0], tile.origin()[1], tile.origin()[2]);
      if (tile.isChild()) {
        gather(at<Upper>(&top, tile.child), 5, 7, origin, bricks);
      } else {
        bricks.add_tile(origin, 1 << 12, tile.state != 0, components(tile.value));
      }
    }
  }

 private:
  /// `bits`: of a child's place along an axis; `child_bits`: of a voxel within it.
  template <class Node>
  void gather(const Node& node, u32 bits, u32 child_bits, ivec3 origin, Bricks& bricks) const {
    const u32 mask = (1u << bits) - 1;
    for (u32 n = 0; n < 1u << (3 * bits); ++n) {
      const ivec3 place(n >> (2 * bits), (n >> bits) & mask, n & mask);
      const ivec3 first = origin + (place << i32(child_bits));
      if (!node.isChild(n)) {
        bricks.add_tile(first, 1 << child_bits, node.isActive(n), components(node.getValue(n)));
      } else if constexpr (std::is_same_v<Node, Upper>) {
        gather(at<Lower>(&node, node.mTable[n].child), 4, 3, first, bricks);
      } else {
        const Leaf& leaf = at<Leaf>(&node, node.mTable[n].child);
        check(&leaf, 0, leaf.memUsage());
        bricks.add_leaf(first, &leaf);
      }
    }
  }

  void check(const void* from, i64 offset, u64 size) const {
    const i64 begin = i64(static_cast<const u8*>(from) - bytes_.data());
    const i64 end = i64(bytes_.size());
    if (offset < -begin || offset > end - begin || size > u64(end - begin - offset) ||
        (begin + offset) % NANOVDB_DATA_ALIGNMENT != 0)
      refuse(name_, "a node leaves its grid");
  }
  template <class Node>
  const Node& at(const void* from, i64 offset) const {
    check(from, offset, sizeof(Node));
    return *reinterpret_cast<const Node*>(static_cast<const u8*>(from) + offset);
  }

  std::span<const u8> bytes_;
  std::string name_;
};

mat4x3 to_glm(const nanovdb::Map& map) {
  mat4x3 m;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) m[column][row] = float(map.mMatD[3 * row + column]);
    m[3][row] = float(map.mVecD[row]);
  }
  return m;
}

/// The types that a volume can show.
template <class... Builds>
struct Types {
  /// Calls visit(Build()) for that of the grid; whether it is one of them.
  static bool visit(GridType type, const auto& visitor) {
    const auto call = [&]<class Build> { visitor.template operator()<Build>(); };
    return (
        (nanovdb::mapToGridType<Builds>() == type && (call.template operator()<Builds>(), true)) ||
        ...);
  }
};
using Shown =
    Types<float, double, std::int16_t, i32, i64, u32, bool, nanovdb::ValueMask, nanovdb::Vec3f,
          nanovdb::Vec3d, nanovdb::Fp4, nanovdb::Fp8, nanovdb::Fp16, nanovdb::FpN>;

u32 channels_of(GridType type) {
  const bool is_vector = type == GridType::Vec3f || type == GridType::Vec3d;
  return Shown::visit(type, []<class> {}) ? (is_vector ? 3 : 1) : 0;
}

class NvdbFile final : public VolumeFile {
 public:
  NvdbFile(std::span<const std::byte> bytes, Budget& budget)
      : size_(bytes.size()),
        stream_(std::span(reinterpret_cast<const char*>(bytes.data()), bytes.size())),
        budget_(budget) {
    stream_.exceptions(std::ios::eofbit | std::ios::failbit | std::ios::badbit);
    guarded("header", [&] {
      do read_segment();
      while (u64(stream_.tellg()) < size_);
    });
  }

  void read(std::size_t entry, const Use& use) override {
    const std::string& name = entries_[entry].name;
    const Place& place = places_[entry];
    budget_.take(place.meta.gridSize, 1, name);
    guarded(name, [&] {
      nanovdb::GridHandle<> handle(nanovdb::HostBuffer::create(place.meta.gridSize));
      if (!handle) throw std::bad_alloc();
      check_packed(place, name);
      stream_.seekg(std::streamoff(place.offset));
      io::Internal::read(stream_, handle, place.codec);
      Shown::visit(place.meta.gridType, [&]<class Build> {
        use_bricks_of<Build>({handle.data(), handle.size()}, name, use);
      });
    });
  }

 private:
  struct Place {
    io::MetaData meta;
    io::Codec codec;
    u64 offset;
  };

  template <class T>
  T take() {
    T value;
    stream_.read(reinterpret_cast<char*>(&value), sizeof value);
    return value;
  }

  /// The library believes how much packed data there is.
  void check_packed(const Place& place, const std::string& name) {
    if (place.codec == io::Codec::NONE) return;
    stream_.seekg(std::streamoff(place.offset));
    if (take<u64>() > place.meta.fileSize) refuse(name, "compressed data is damaged");
  }

  void read_segment() {
    const auto header = take<io::Header>();
    if (header.magic != NANOVDB_MAGIC_NUMBER && header.magic != kFileMagic)
      refuse("header", "is not a NanoVDB file");
    if (header.version.getMajor() != kMajor)
      refuse_unimplemented("header", fmt::format("NanoVDB version {}; {} is read",
                                                 header.version.getMajor(), kMajor));
    if (header.codec >= io::Codec::END)
      refuse_unimplemented("header", fmt::format("compression {}", u32(header.codec)));
    if (header.gridCount == 0) refuse("header", "the file has no grids");
    for (u32 i = 0; i < header.gridCount; ++i) add_entry(header.codec);
    u64 offset = u64(stream_.tellg());
    for (std::size_t i = places_.size() - header.gridCount; i < places_.size(); ++i) {
      if (places_[i].meta.fileSize > size_ - offset)
        refuse(entries_[i].name, "the file is truncated");
      places_[i].offset = offset;
      offset += places_[i].meta.fileSize;
    }
    stream_.seekg(std::streamoff(offset));
  }

  void add_entry(io::Codec codec) {
    const auto meta = take<io::MetaData>();
    if (meta.nameSize > kLongestName) refuse("header", "a name is too long");
    std::string name(meta.nameSize, '\0');
    stream_.read(name.data(), std::streamsize(name.size()));
    const u32 channels = channels_of(meta.gridType);
    entries_.push_back(
        {.name = clean_name(name.substr(0, name.find('\0')), "grid"),
         .channels = channels,
         .why = channels ? "" : fmt::format("values of NanoVDB's type {}", u32(meta.gridType))});
    places_.push_back({.meta = meta, .codec = codec, .offset = 0});
  }

  template <class Build>
  void use_bricks_of(std::span<const u8> bytes, const std::string& name, const Use& use) {
    if (bytes.size() < sizeof(nanovdb::GridData)) refuse(name, "is not a NanoVDB grid");
    const auto& grid = *reinterpret_cast<const nanovdb::GridData*>(bytes.data());
    const u64 magic = grid.mMagic;
    if (magic >> 8 != NANOVDB_MAGIC_NUMBER >> 8 && magic << 8 != u64(NANOVDB_MAGIC_NUMBER) << 8)
      refuse(name, "is not a NanoVDB grid");
    const Nodes<Build> nodes(bytes, name);
    const float background = components(nodes.root().mBackground)[0];
    using Leaf = typename Nodes<Build>::Leaf;
    const GridLook look{.channels = kChannelsOf<typename Leaf::ValueType>,
                        .level_set = grid.mGridClass == nanovdb::GridClass::LevelSet,
                        .background = std::abs(background),
                        .object_from_index = to_glm(grid.mMap)};
    Bricks bricks(name, look, budget_);
    nodes.gather(bricks);
    use(bricks, write_leaf<Leaf>);
  }

  const u64 size_;
  std::ispanstream stream_;
  Budget& budget_;
  std::vector<Place> places_;
};

}  // namespace

std::unique_ptr<VolumeFile> open_nvdb(std::span<const std::byte> file, Budget& budget) {
  return std::make_unique<NvdbFile>(file, budget);
}

}  // namespace heliograph::assets
