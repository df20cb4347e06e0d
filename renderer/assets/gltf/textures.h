// The textures a glTF's materials use: one for each (image, sampler, encoding).
#pragma once

#include <memory>
#include <vector>

#include "renderer/assets/gltf/document.h"

namespace heliograph::assets::gltf {

/// Collects uses first, decodes all images at once, and then makes the library's first edits, so
/// that the k-th texture is CreatedByEdit{k}.
class Textures {
 public:
  Textures(Document& document, Builder& builder) : document_(document), builder_(builder) {}

  /// The use that a textureInfo describes; nothing when its image cannot be had (reported).
  ///
  /// channel  the component a scalar parameter reads; ignored for colours
  [[nodiscard]] Boxed<TextureUsePatch> use(const Value& info, bool srgb, u32 channel);

  /// Decodes what was used, on all processors, and adds the texture edits to the library.
  void make_library();

  /// The decoded image behind a use.
  [[nodiscard]] const std::shared_ptr<const ImageData>& image(const TextureUsePatch& use) const {
    return images_[slot(use).image];
  }
  /// The texture behind a use, without its image.
  [[nodiscard]] PutTexture layout(const TextureUsePatch& use) const { return layout(slot(use)); }

 private:
  struct Slot {
    u32 texture = 0;
    u32 image = 0;
    bool srgb = false;
    bool nearest = false;
    Wrap wrap_u = Wrap::kRepeat;
    Wrap wrap_v = Wrap::kRepeat;
    bool operator==(const Slot&) const = default;
  };
  [[nodiscard]] std::optional<Slot> slot_of(const Value& texture, u32 index) const;
  [[nodiscard]] const Slot& slot(const TextureUsePatch& use) const {
    return slots_[std::get<CreatedByEdit>(use.texture).edit];
  }
  [[nodiscard]] static PutTexture layout(const Slot& slot);
  void decode_images();

  Document& document_;
  Builder& builder_;
  std::vector<Slot> slots_;
  std::vector<std::shared_ptr<const ImageData>> images_;  // by image; null: not used
};

}  // namespace heliograph::assets::gltf
