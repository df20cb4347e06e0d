// Asset to AssetInfo.
#include "server/convert/asset.h"

#include "server/convert/array.h"

namespace heliograph::server {
namespace {

std::string name_of(const Edit& edit) {
  const auto* name = std::get_if<std::string>(&edit.target);
  return name ? *name : std::string();
}

/// Adds an edit's name to the list of its kind.
struct AddName {
  const Edit& edit;
  v1::AssetInfo& info;

  void operator()(const PutMesh&) const { info.add_meshes(name_of(edit)); }
  void operator()(const PutMaterial&) const { info.add_materials(name_of(edit)); }
  void operator()(const PutTexture&) const { info.add_textures(name_of(edit)); }
  void operator()(const PutVolume&) const { info.add_volumes(name_of(edit)); }
  void operator()(const PutEntity& entity) const {
    info.add_entities(name_of(edit));
    if (entity.camera && *entity.camera) info.add_cameras(name_of(edit));
  }
  void operator()(const auto&) const {}
};

constexpr std::size_t kPieceBytes = 1u << 20;

/// Moves names from the end of a list into pieces.
class Cutter {
 public:
  explicit Cutter(std::vector<v1::AssetInfo>& pieces) : pieces_(pieces) {}

  using Names = google::protobuf::RepeatedPtrField<std::string>;
  void take(Names& names, Names* (v1::AssetInfo::*list)()) {
    for (std::string& name : names) {
      if (bytes_ > 0 && bytes_ + name.size() > kPieceBytes) {
        pieces_.emplace_back();
        bytes_ = 0;
      }
      bytes_ += name.size() + 8;
      *(pieces_.back().*list)()->Add() = std::move(name);
    }
    names.Clear();
  }

 private:
  std::vector<v1::AssetInfo>& pieces_;
  std::size_t bytes_ = 0;
};

void inline_sink(const BufferPtr& bytes, v1::Array& array) {
  array.set_inline_(bytes->bytes().data(), bytes->bytes().size());
}

}  // namespace

v1::AssetInfo to_info(const Asset& asset, const vec3& bounds_min, const vec3& bounds_max) {
  v1::AssetInfo info;
  info.set_sha256(asset.hash);
  for (const auto& edits : {&asset.library, &asset.entities})
    for (const Edit& edit : *edits) std::visit(AddName{edit, info}, edit.action);
  for (const Asset::Animation& animation : asset.animations) info.add_animations(animation.name);
  const u64 shape[] = {2, 3};
  *info.mutable_bounds() = to_array(std::vector<float>{bounds_min.x, bounds_min.y, bounds_min.z,
                                                       bounds_max.x, bounds_max.y, bounds_max.z},
                                    shape, inline_sink);
  return info;
}

v1::AssetInfo to_info(const ImageData& image, bool srgb, const std::string& blob) {
  v1::AssetInfo info;
  *info.mutable_texels() =
      to_proto(image, [&](const BufferPtr&, v1::Array& array) { array.set_blob(blob); });
  info.set_encoding(srgb ? v1::Texture::ENCODING_SRGB : v1::Texture::ENCODING_LINEAR);
  return info;
}

std::vector<v1::AssetInfo> cut(const v1::AssetInfo& info) {
  v1::AssetInfo rest = info;
  std::vector<v1::AssetInfo> pieces(1);
  Cutter cutter(pieces);
  using Info = v1::AssetInfo;
  cutter.take(*rest.mutable_entities(), &Info::mutable_entities);
  cutter.take(*rest.mutable_meshes(), &Info::mutable_meshes);
  cutter.take(*rest.mutable_materials(), &Info::mutable_materials);
  cutter.take(*rest.mutable_textures(), &Info::mutable_textures);
  cutter.take(*rest.mutable_cameras(), &Info::mutable_cameras);
  cutter.take(*rest.mutable_animations(), &Info::mutable_animations);
  cutter.take(*rest.mutable_volumes(), &Info::mutable_volumes);
  cutter.take(*rest.mutable_warnings(), &Info::mutable_warnings);
  pieces.back().MergeFrom(rest);
  return pieces;
}

}  // namespace heliograph::server
