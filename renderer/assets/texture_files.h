// Textures that a model names by their files, each decoded once. Used by MTL, COLLADA and the
// formats of assimp.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "renderer/assets/builder.h"

namespace heliograph::assets {

/// How a material uses a file.
struct TextureFile {
  std::string path;  // in the bundle; of an embedded one, its name in the model
  std::string where;
  bool srgb = false;
  Wrap wrap_u = Wrap::kRepeat, wrap_v = Wrap::kRepeat;
  std::span<const std::byte> embedded{};  // its bytes, when it is within the model
};

/// Adds textures to the library, whose first edits they are.
class TextureFiles {
 public:
  explicit TextureFiles(Builder& builder) : builder_(builder) {}

  /// Nothing: the bundle lacks the file, which the builder now knows.
  [[nodiscard]] Boxed<TextureUsePatch> use(const TextureFile& file);
  /// The channel that an opacity is in: alpha where there is one.
  [[nodiscard]] u32 opacity_channel(const TextureUsePatch& use) const;

 private:
  Builder& builder_;
  std::map<std::tuple<std::string, bool, Wrap, Wrap>, Ref> textures_;
  std::vector<u32> channels_;  // by texture
};

}  // namespace heliograph::assets
