#include "renderer/assets/texture_files.h"

#include "renderer/assets/picture.h"

namespace heliograph::assets {

Boxed<TextureUsePatch> TextureFiles::use(const TextureFile& file) {
  std::span<const std::byte> bytes = file.embedded;
  if (bytes.empty()) {
    const BundleFile* found = builder_.bundle.find(file.path);
    if (!found) {
      builder_.missing(file.path);
      return {};
    }
    bytes = found->bytes;
  }
  const auto key = std::tuple(file.path, file.srgb, file.wrap_u, file.wrap_v);
  auto known = textures_.find(key);
  if (known == textures_.end()) {
    Picture picture = decode_picture(bytes, extension_of(file.path), file.where, builder_.budget);
    for (const std::string& warning : picture.warnings) {
      builder_.warn(fmt::format("{}: {}", file.path, warning));
    }
    channels_.push_back(picture.image.channels);
    PutTexture put{.image = std::make_shared<const ImageData>(std::move(picture.image))};
    put.srgb = file.srgb && picture.srgb;
    put.wrap_u = file.wrap_u;
    put.wrap_v = file.wrap_v;
    const std::string name = builder_.claim_name(stem_of(file.path), "texture");
    known = textures_.emplace(key, builder_.library(name, std::move(put))).first;
  }
  return TextureUsePatch{.texture = known->second, .use = {}};
}

u32 TextureFiles::opacity_channel(const TextureUsePatch& use) const {
  const u32 channels = channels_[std::get<CreatedByEdit>(use.texture).edit];
  return channels % 2 == 0 ? 3 : 0;  // kernels read grey with alpha as three colours and alpha
}

}  // namespace heliograph::assets
