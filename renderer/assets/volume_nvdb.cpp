// NanoVDB files of version 32: grids of float, vec3f, fp4, fp8, fp16 and fpN.
// Source of the layout: NanoVDB 32, NanoVDB.h (GridData, TreeData, RootData, InternalData,
// LeafData) and util/IO.h (FileHeader, FileMetaData, the codecs).
#include <zlib.h>

#include <algorithm>

#include "renderer/assets/volume_bricks.h"
#include "renderer/assets/volume_bytes.h"

namespace heliograph::assets {
namespace {

using Bytes = std::span<const std::byte>;

constexpr u64 kMagic = 0x304244566f6e614eull;      // "NanoVDB0"
constexpr u64 kFileMagic = 0x324244566f6e614eull;  // "NanoVDB2"
constexpr u32 kMajor = 32;

enum GridType : u32 { kFloat = 1, kVec3f = 6, kFp4 = 13, kFp8 = 14, kFp16 = 15, kFpN = 16 };
enum Codec : u16 { kNone = 0, kZip = 1, kBlosc = 2 };

struct FileMeta {
  u64 grid_bytes, file_bytes, name_key, voxels;
  u32 type, grid_class;
  double world_box[6];
  i32 index_box[6];
  double voxel_size[3];
  u32 name_bytes, nodes[4], tiles[3];
  u16 codec, padding;
  u32 version;
};
static_assert(sizeof(FileMeta) == 176);

// Offsets within a grid.
constexpr u64 kGridBytes = 672, kMap = 296, kMatD = kMap + 88, kVecD = kMatD + 144;
constexpr u64 kTreeRoot = 24;  // of the root's offset, within the tree
// The root: a box, the table's size, then five values or statistics; tiles of 32 bytes.
constexpr u64 kTableSize = 24, kBackground = 28, kTileBytes = 32;

constexpr u64 round_up(u64 size) { return (size + 31) / 32 * 32; }

/// How the nodes of one type of grid lie in memory.
struct Layout {
  u32 type;
  u32 channels;
  u64 value;  // bytes of a value in root and internal nodes

  [[nodiscard]] u64 root_header() const { return round_up(kBackground + 3 * value + 8); }
  /// Box, flags and two masks of side^3 bits, then minimum, maximum, average and deviation.
  [[nodiscard]] u64 internal_header(u32 side) const {
    return round_up(32 + 2 * u64(side) * side * side / 8 + 2 * value + 8);
  }
  [[nodiscard]] u64 entry() const { return value > 8 ? 16 : 8; }  // a value or a child's offset
  /// Where a leaf's values or codes begin.
  [[nodiscard]] u64 leaf_header() const { return type == kVec3f ? 128 : 96; }
};

class NanoReader {
 public:
  NanoReader(Bytes bytes, const Layout& layout, FileGrid& grid)
      : bytes_(bytes), layout_(layout), grid_(grid) {}

  void read() {
    const u64 root = kGridBytes + read_at<u64>(bytes_, kGridBytes + kTreeRoot);
    const u32 tiles = read_at<u32>(bytes_, root + kTableSize);
    grid_.background = std::abs(read_at<float>(bytes_, root + kBackground));
    for (u32 i = 0; i < tiles; ++i) {
      const u64 tile = root + layout_.root_header() + i * kTileBytes;
      const u64 key = read_at<u64>(bytes_, tile);
      const auto axis = [key](u32 shift) { return i32(u32((key >> shift) & 0x1fffff) << 12); };
      const ivec3 origin(axis(42), axis(21), axis(0));
      const u64 child = read_at<u64>(bytes_, tile + 8);
      if (child != 0)
        internal<32>(root + child, origin);
      else
        add_tile({origin, 4096, read_at<u32>(bytes_, tile + 16) != 0}, tile + 20);
    }
  }

 private:
  void add_tile(const FileGrid::Tile& tile, u64 at) {
    float value[3];
    for (u32 c = 0; c < layout_.channels; ++c) value[c] = read_at<float>(bytes_, at + 4ull * c);
    grid_.add_tile(tile, value);
  }

  /// A node of Side^3 children: of 32 nodes of 16, of 16 leaves.
  template <u32 Side>
  void internal(u64 node, ivec3 origin) {
    constexpr u32 count = Side * Side * Side;
    constexpr i32 child_side = Side == 32 ? 128 : kBrickSide;
    const u64 table = node + layout_.internal_header(Side);
    const Bytes active = part_of(bytes_, node + 32, count / 8);
    const Bytes children = part_of(bytes_, node + 32 + count / 8, count / 8);
    for (u32 i = 0; i < count; ++i) {
      const ivec3 at(i / (Side * Side), i / Side % Side, i % Side);
      const ivec3 first = origin + at * child_side;
      const u64 entry = table + i * layout_.entry();
      if (!bit_at(children, i)) {
        add_tile({first, child_side, bit_at(active, i)}, entry);
        continue;
      }
      const u64 child = node + read_at<u64>(bytes_, entry);
      if constexpr (Side == 32)
        internal<16>(child, first);
      else
        leaf(child, first);
    }
  }

  void leaf(u64 node, ivec3 origin) {
    float* out = grid_.add_brick(origin);
    const u64 values = node + layout_.leaf_header();
    if (layout_.type == kFloat || layout_.type == kVec3f) {
      const u64 size = u64(kBrickVoxels) * layout_.channels * sizeof(float);
      std::memcpy(out, part_of(bytes_, values, size).data(), size);
      return;
    }
    const auto minimum = read_at<float>(bytes_, node + 80);
    const auto quantum = read_at<float>(bytes_, node + 84);
    const u32 bits = layout_.type == kFp4    ? 4
                     : layout_.type == kFp8  ? 8
                     : layout_.type == kFp16 ? 16
                                             : 1u << (read_at<u8>(bytes_, node + 15) >> 5);
    if (bits > 16) refuse(grid_.name(), "has a leaf of more than 16 bits a voxel");
    for (u32 i = 0; i < kBrickVoxels; ++i)
      out[i] = float(code(values, i, bits)) * quantum + minimum;
  }

  [[nodiscard]] u32 code(u64 codes, u32 i, u32 bits) const {
    const u32 first = i * bits;
    if (bits == 16) return read_at<u16>(bytes_, codes + first / 8);
    return (u32(read_at<u8>(bytes_, codes + first / 8)) >> (first % 8)) & ((1u << bits) - 1);
  }

  const Bytes bytes_;
  const Layout layout_;
  FileGrid& grid_;
};

std::vector<std::byte> unpack(const FileMeta& meta, u16 codec, Bytes packed, Budget& budget) {
  budget.take(meta.grid_bytes, 1, "grids");
  if (codec == kNone) return {packed.begin(), packed.end()};
  if (codec != kZip)
    refuse_unimplemented("header", codec == kBlosc ? "compression by BLOSC; use ZIP or none"
                                                   : fmt::format("codec {}", codec));
  Cursor cursor(packed);
  return inflate(cursor.span(cursor.take<u64>()), meta.grid_bytes);
}

mat4x3 transform_of(Bytes grid) {
  mat4x3 m;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      m[column][row] = float(read_at<double>(grid, kMatD + 8 * u64(3 * row + column)));
    m[3][row] = float(read_at<double>(grid, kVecD + 8 * u64(row)));
  }
  return m;
}

void read_grid(const FileMeta& meta, std::string name, Bytes bytes, VolumeFile& file,
               Budget& budget) {
  constexpr u32 kLevelSet = 1;
  constexpr std::array kTypes{Layout{kFloat, 1, 4}, Layout{kVec3f, 3, 12}, Layout{kFp4, 1, 4},
                              Layout{kFp8, 1, 4},   Layout{kFp16, 1, 4},   Layout{kFpN, 1, 4}};
  const auto layout = std::ranges::find(kTypes, meta.type, &Layout::type);
  if (layout == kTypes.end()) {
    file.skipped.push_back(fmt::format("{} (values of type {})", name, meta.type));
    return;
  }
  if (const u64 magic = read_at<u64>(bytes, 0); magic != kMagic && magic >> 8 != kMagic >> 8)
    refuse(name, "is not a NanoVDB grid");
  FileGrid& grid = file.grids.emplace_back(name, layout->channels, budget);
  grid.level_set = meta.grid_class == kLevelSet;
  grid.object_from_index = transform_of(bytes);
  NanoReader(bytes, *layout, grid).read();
}

}  // namespace

std::vector<std::byte> inflate(Bytes packed, u64 size) {
  std::vector<std::byte> out(size);
  auto length = uLongf(size);
  const int code = uncompress(reinterpret_cast<Bytef*>(out.data()), &length,
                              reinterpret_cast<const Bytef*>(packed.data()), packed.size());
  if (code != Z_OK || length != size) refuse("nodes", "compressed data is damaged");
  return out;
}

VolumeFile read_nvdb(Bytes bytes, Budget& budget) {
  Cursor cursor(bytes);
  const u64 magic = cursor.take<u64>();
  if (magic != kMagic && magic != kFileMagic) refuse("header", "is not a NanoVDB file");
  const u32 version = cursor.take<u32>();
  if (version >> 21 != kMajor)
    refuse_unimplemented("header",
                         fmt::format("NanoVDB version {}; {} is read", version >> 21, kMajor));
  const u16 count = cursor.take<u16>();
  const u16 codec = cursor.take<u16>();
  if (count == 0) refuse("header", "the file has no grids");
  std::vector<std::pair<FileMeta, std::string>> metas;
  for (u32 i = 0; i < count; ++i) {
    const auto meta = cursor.take<FileMeta>();
    std::string name = cursor.text(meta.name_bytes);
    metas.emplace_back(meta, name.substr(0, name.find('\0')));
  }
  VolumeFile file;
  file.grids.reserve(metas.size());
  for (auto& [meta, name] : metas) {
    const std::vector<std::byte> grid = unpack(meta, codec, cursor.span(meta.file_bytes), budget);
    read_grid(meta, std::move(name), grid, file, budget);
  }
  return file;
}

}  // namespace heliograph::assets
