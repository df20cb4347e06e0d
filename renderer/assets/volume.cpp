// Volumes: .nvdb and .vdb are kept as they are; only the names of their grids are read here, from
// the header, by hand. Chosen by load.cpp.
// Source: NanoVDB 32, util/IO.h (FileHeader, FileMetaData); OpenVDB 10, io/Archive.cc.
#include <cstring>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets {
namespace {

constexpr u32 kMostGrids = 4096;

class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> bytes) : bytes_(bytes) {}

  template <class T>
  T take() {
    T value;
    std::memcpy(&value, skip(sizeof(T)), sizeof(T));
    return value;
  }
  const std::byte* skip(u64 count) {
    if (count > bytes_.size() - at_) refuse("header", "the file is truncated");
    at_ += count;
    return bytes_.data() + at_ - count;
  }
  void seek(u64 to) {
    if (to < at_ || to > bytes_.size()) refuse("header", "a grid leaves the file");
    at_ = to;
  }
  std::string text(u64 length) {
    constexpr u64 kLongest = 1 << 16;
    if (length > kLongest) refuse("header", "a name is too long");
    return {reinterpret_cast<const char*>(skip(length)), length};
  }
  /// 32 bits of length, then the characters.
  std::string text() { return text(take<u32>()); }

 private:
  std::span<const std::byte> bytes_;
  u64 at_ = 0;
};

constexpr u64 kNanoMagic = 0x304244566f6e614eull;      // "NanoVDB0"
constexpr u64 kNanoFileMagic = 0x324244566f6e614eull;  // "NanoVDB2"
constexpr i64 kVdbMagic = 0x56444220;

std::vector<std::string> nanovdb_grids(Cursor cursor) {
  const u64 magic = cursor.take<u64>();
  if (magic != kNanoMagic && magic != kNanoFileMagic) refuse("header", "is not a NanoVDB file");
  const u32 version = cursor.take<u32>();
  if (version >> 21 != 32) {
    refuse_unimplemented("header", fmt::format("NanoVDB version {}; 32 is read", version >> 21));
  }
  const u16 count = cursor.take<u16>();
  (void)cursor.take<u16>();  // codec
  struct Meta {
    u64 grid_bytes, file_bytes, name_key, voxels;
    u32 type, grid_class;
    double world_box[6];
    i32 index_box[6];
    double voxel_size[3];
    u32 name_bytes, nodes[4], tiles[3];
    u16 codec, padding;
    u32 version;
  };
  static_assert(sizeof(Meta) == 176);
  std::vector<std::string> names;
  std::vector<u64> sizes;
  for (u32 i = 0; i < count; ++i) {
    const Meta meta = cursor.take<Meta>();
    std::string name = cursor.text(meta.name_bytes);
    names.push_back(name.substr(0, name.find('\0')));
    sizes.push_back(meta.file_bytes);
  }
  for (const u64 size : sizes) (void)cursor.skip(size);
  return names;
}

std::vector<std::string> vdb_grids(Cursor cursor) {
  constexpr u32 kOldest = 222;  // grid offsets and a UUID as text
  if (cursor.take<i64>() != kVdbMagic) refuse("header", "is not a VDB file");
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
  std::vector<std::string> names;
  for (u32 i = 0; i < count; ++i) {
    std::string name = cursor.text();
    names.push_back(name.substr(0, name.find('\x1e')));  // a suffix keeps equal names apart
    (void)cursor.text();                                 // type
    (void)cursor.text();                                 // instance parent
    (void)cursor.skip(16);                               // offsets of the grid and its blocks
    cursor.seek(cursor.take<u64>());                     // its end
  }
  return names;
}

}  // namespace

void load_volume(Builder& builder) {
  const BundleFile& file = builder.bundle.model();
  const std::string format =
      builder.options.format.empty() ? extension_of(file.path) : builder.options.format;
  const Cursor cursor(file.bytes);
  auto volume = std::make_shared<Volume>();
  std::vector<std::string> names = format == "nvdb" ? nanovdb_grids(cursor) : vdb_grids(cursor);
  if (names.empty()) refuse("header", "the file has no grids");
  for (const std::string& name : names) volume->grids.push_back(clean_name(name, "grid"));
  volume->bytes = std::make_shared<const Buffer>(nullptr, file.bytes);
  const std::string stem = stem_of(file.path);
  const Ref ref = builder.library(builder.claim_name(stem, "volume"), PutVolume{std::move(volume)});
  PutEntity root;
  const float metres = builder.options.units > 0 ? float(builder.options.units) : 1.0f;
  const mat3 turned = z_up_from(builder.options.up) * metres;
  if (turned == mat3(1)) {
    root.volume = ref;
    builder.entity("", std::move(root));
    return;
  }
  // Voxels cannot be rewritten, so axes and units go into an entity below the root.
  PutEntity below;
  below.parent = builder.entity_ref(builder.entity("", std::move(root)));
  below.volume = ref;
  below.pose = constant_pose(mat4x3(turned[0], turned[1], turned[2], vec3(0)));
  builder.entity(builder.claim_name("volume", "volume"), std::move(below));
}

}  // namespace heliograph::assets
