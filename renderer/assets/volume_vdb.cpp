// OpenVDB files since version 222 (OpenVDB 3): trees 5-4-3 of float and vec3s, also as halves,
// compressed by ZIP, BLOSC or not. docs/decisions/009 says why this is not OpenVDB itself.
// Source of the format: OpenVDB 10, io/Archive.cc, io/Compression.h, tree/RootNode.h,
// tree/InternalNode.h, tree/LeafNode.h, math/Maps.h.
#include <blosc.h>

#include <array>

#include "renderer/assets/bundle.h"
#include "renderer/assets/volume_bricks.h"
#include "renderer/assets/volume_bytes.h"
#include "renderer/base/half.h"

namespace heliograph::assets {
namespace {

using Bytes = std::span<const std::byte>;

constexpr i64 kMagic = 0x56444220;
constexpr u32 kOldest = 222;  // masks in nodes, compression by grid, a UUID as text
constexpr u32 kMostGrids = 4096;

enum Compression : u32 { kZip = 1, kActiveMask = 2, kBlosc = 4 };
/// What a node says of its inactive values.
enum NodeData : u8 {
  kBackgroundOnly,
  kMinusBackground,
  kOneInactive,
  kMaskOfBackgrounds,
  kMaskAndOne,
  kMaskAndTwo,
  kAllValues
};

struct Entry {
  std::string name, type, parent;
  u64 begin, end;
};

std::vector<Entry> read_entries(Cursor& cursor) {
  if (cursor.take<i64>() != kMagic) refuse("header", "is not a VDB file");
  const u32 version = cursor.take<u32>();
  if (version < kOldest) refuse_unimplemented("header", fmt::format("VDB version {}", version));
  (void)cursor.skip(8);  // the library's version
  const bool has_offsets = cursor.take<u8>() != 0;
  (void)cursor.text(36);  // UUID
  for (u32 left = cursor.take<u32>(); left > 0; --left) {
    (void)cursor.text();  // name
    (void)cursor.text();  // type
    (void)cursor.skip(cursor.take<u32>());
  }
  const u32 count = cursor.take<u32>();
  if (count > kMostGrids) refuse("header", fmt::format("claims {} grids", count));
  if (!has_offsets) refuse_unimplemented("header", "a VDB stream without grid offsets");
  std::vector<Entry> entries;
  for (u32 i = 0; i < count; ++i) {
    Entry entry;
    entry.name = cursor.text();
    entry.name = entry.name.substr(0, entry.name.find('\x1e'));  // keeps equal names apart
    entry.type = cursor.text();
    entry.parent = cursor.text();
    entry.begin = cursor.take<u64>();
    (void)cursor.take<u64>();  // where its blocks begin
    entry.end = cursor.take<u64>();
    if (entry.end < entry.begin) refuse("header", "a grid ends before it begins");
    cursor.seek(entry.end);
    entries.push_back(std::move(entry));
  }
  return entries;
}

/// The map from index space, row vectors as in OpenVDB turned to columns.
mat4x3 read_transform(Cursor& cursor, const std::string& grid) {
  const std::string type = cursor.text();
  const auto vector = [&] {
    vec3 v;
    for (int i = 0; i < 3; ++i) v[i] = float(cursor.take<double>());
    return v;
  };
  mat4x3 m(1);
  if (type == "AffineMap" || type == "UnitaryMap") {
    for (int row = 0; row < 4; ++row) {
      m[row] = vector();
      (void)cursor.take<double>();
    }
    return m;
  }
  if (type == "TranslationMap" || type == "ScaleTranslateMap" || type == "UniformScaleTranslateMap")
    m[3] = vector();
  if (type != "TranslationMap") {
    if (type.find("Scale") == std::string::npos)
      refuse_unimplemented(
          grid, fmt::format("a transform of type {}", clean_name(type.substr(0, 64), "map")));
    const vec3 scale = vector();
    for (int i = 0; i < 3; ++i) m[i][i] = scale[i];
    (void)cursor.skip(12 * sizeof(double));  // voxel size, inverses
  }
  return m;
}

/// Reads the tree of one grid, front to back.
class TreeReader {
 public:
  TreeReader(Cursor& cursor, u32 compression, bool half, FileGrid& grid)
      : cursor_(cursor), compression_(compression), half_(half), grid_(grid) {}

  void read() {
    if (cursor_.take<u32>() != 1) refuse(grid_.name(), "has several buffers a voxel");
    background_ = value();
    grid_.background = std::abs(background_[0]);
    const u32 tiles = cursor_.take<u32>();
    const u32 children = cursor_.take<u32>();
    for (u32 i = 0; i < tiles; ++i) {
      const auto origin = cursor_.take<ivec3>();
      const Value tile = value();
      const bool is_active = cursor_.take<u8>() != 0;
      grid_.add_tile({origin, 4096, is_active}, tile.data());
    }
    for (u32 i = 0; i < children; ++i) {
      const auto origin = cursor_.take<ivec3>();
      internal<32>(origin);
    }
    for (const ivec3 origin : leaves_) leaf(origin);
  }

 private:
  using Value = std::array<float, 3>;

  [[nodiscard]] u32 channels() const { return grid_.channels(); }
  Value value() {
    Value v{};
    for (u32 c = 0; c < channels(); ++c) v[c] = cursor_.take<float>();
    return v;
  }

  /// The topology beneath a node of Side^3 children: of 32 nodes of 16, of 16 leaves.
  template <u32 Side>
  void internal(ivec3 origin) {
    constexpr u32 kCount = Side * Side * Side;
    constexpr i32 kChildSide = Side == 32 ? 128 : kBrickSide;
    const Bytes children = cursor_.span(kCount / 8);
    const Bytes active = cursor_.span(kCount / 8);
    std::vector<float> tiles(std::size_t(kCount) * channels());
    values(active, tiles);
    const auto at = [&](u32 i) {
      return origin + ivec3(i / (Side * Side), i / Side % Side, i % Side) * kChildSide;
    };
    for (u32 i = 0; i < kCount; ++i)
      if (!bit_at(children, i))
        grid_.add_tile({at(i), kChildSide, bit_at(active, i)}, tiles.data() + i * channels());
    for (u32 i = 0; i < kCount; ++i) {
      if (!bit_at(children, i)) continue;
      if constexpr (Side == 32) {
        internal<16>(at(i));
      } else {
        (void)cursor_.skip(kBrickVoxels / 8);  // its mask comes again with its values
        leaves_.push_back(at(i));
      }
    }
  }

  void leaf(ivec3 origin) {
    const Bytes active = cursor_.span(kBrickVoxels / 8);
    float* out = grid_.add_brick(origin);
    values(active, {out, std::size_t(kBrickVoxels) * channels()});
  }

  /// The values of a node, inactive ones filled in.
  void values(Bytes active, std::span<float> out) {
    const u32 count = u32(out.size() / channels());
    const u8 data = cursor_.take<u8>();
    if (data > kAllValues) refuse(grid_.name(), "has a node of an unknown kind");
    Value inactive[2] = {background_, background_};
    if (data != kBackgroundOnly)
      for (float& v : inactive[0]) v = -v;
    if (data == kOneInactive || data == kMaskAndOne || data == kMaskAndTwo) inactive[0] = value();
    if (data == kMaskAndTwo) inactive[1] = value();
    const bool masked = data == kMaskOfBackgrounds || data == kMaskAndOne || data == kMaskAndTwo;
    const Bytes choice = masked ? cursor_.span(count / 8) : Bytes();
    const bool sparse = (compression_ & kActiveMask) && data != kAllValues;
    u32 stored = count;
    if (sparse) {
      stored = 0;
      for (u32 i = 0; i < count; ++i) stored += bit_at(active, i);
    }
    const std::vector<float> read = floats(std::size_t(stored) * channels());
    const float* next = read.data();
    for (u32 i = 0; i < count; ++i) {
      const bool is_stored = !sparse || bit_at(active, i);
      const float* from = is_stored ? next : inactive[masked && bit_at(choice, i)].data();
      if (is_stored) next += channels();
      std::copy_n(from, channels(), out.data() + i * channels());
    }
  }

  std::vector<float> floats(std::size_t count) {
    std::vector<float> out(count);
    if (!half_) {
      unpack(std::as_writable_bytes(std::span(out)));
      return out;
    }
    if (count == 0) return out;  // of halves not even a size is written
    std::vector<u16> halves(count);
    unpack(std::as_writable_bytes(std::span(halves)));
    for (std::size_t i = 0; i < count; ++i) out[i] = float_of_half(halves[i]);
    return out;
  }

  void unpack(std::span<std::byte> out) {
    if (!(compression_ & (kZip | kBlosc))) {
      if (!out.empty()) std::memcpy(out.data(), cursor_.skip(out.size()), out.size());
      return;
    }
    const i64 size = cursor_.take<i64>();
    if (size <= 0) {  // not worth packing
      if (u64(-size) != out.size()) refuse(grid_.name(), "has a block of the wrong size");
      if (!out.empty()) std::memcpy(out.data(), cursor_.skip(out.size()), out.size());
      return;
    }
    const Bytes packed = cursor_.span(u64(size));
    if (compression_ & kBlosc) {
      std::size_t bytes = 0;
      if (blosc_cbuffer_validate(packed.data(), packed.size(), &bytes) < 0 || bytes != out.size() ||
          blosc_decompress_ctx(packed.data(), out.data(), out.size(), 1) != int(out.size()))
        refuse(grid_.name(), "compressed data is damaged");
      return;
    }
    const std::vector<std::byte> bytes = inflate(packed, out.size());
    std::memcpy(out.data(), bytes.data(), bytes.size());
  }

  Cursor& cursor_;
  const u32 compression_;
  const bool half_;
  FileGrid& grid_;
  Value background_{};
  std::vector<ivec3> leaves_;  // in the order of their values
};

bool read_is_level_set(Cursor& cursor) {
  bool level_set = false;
  for (u32 left = cursor.take<u32>(); left > 0; --left) {
    const std::string name = cursor.text();
    (void)cursor.text();  // type
    const u32 size = cursor.take<u32>();
    const Bytes value = cursor.span(size);
    const std::string_view text(reinterpret_cast<const char*>(value.data()), value.size());
    level_set = level_set || (name == "class" && text == "level set");
  }
  return level_set;
}

void read_grid(const Entry& entry, Bytes bytes, VolumeFile& file, Budget& budget) {
  constexpr std::string_view kHalf = "_HalfFloat";
  std::string type = entry.type;
  const bool half = type.ends_with(kHalf);
  if (half) type.resize(type.size() - kHalf.size());
  const u32 channels = type == "Tree_float_5_4_3" ? 1 : type == "Tree_vec3s_5_4_3" ? 3 : 0;
  if (channels == 0 || !entry.parent.empty()) {
    file.skipped.push_back(fmt::format(
        "{} ({})", entry.name, channels == 0 ? "of type " + type : "shares another's tree"));
    return;
  }
  Cursor cursor(bytes.first(entry.end));
  cursor.seek(entry.begin);
  const u32 compression = cursor.take<u32>();
  FileGrid& grid = file.grids.emplace_back(entry.name, channels, budget);
  grid.level_set = read_is_level_set(cursor);
  grid.object_from_index = read_transform(cursor, entry.name);
  TreeReader(cursor, compression, half, grid).read();
}

}  // namespace

VolumeFile read_vdb(Bytes bytes, Budget& budget) {
  Cursor cursor(bytes);
  const std::vector<Entry> entries = read_entries(cursor);
  if (entries.empty()) refuse("header", "the file has no grids");
  VolumeFile file;
  file.grids.reserve(entries.size());
  for (const Entry& entry : entries) read_grid(entry, bytes, file, budget);
  return file;
}

}  // namespace heliograph::assets
