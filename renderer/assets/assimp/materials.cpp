// Materials of assimp in ours. Those of Phong's time become metallic-roughness as in MTL.
#include <assimp/material.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "renderer/assets/assimp/scene.h"
#include "renderer/assets/phong.h"
#include "renderer/assets/texture_files.h"

namespace heliograph::assets::assimp {
namespace {

using enum MaterialParameter;

Wrap wrap_of(aiTextureMapMode mode) {
  if (mode == aiTextureMapMode_Mirror) return Wrap::kMirror;
  return mode == aiTextureMapMode_Wrap ? Wrap::kRepeat : Wrap::kClamp;
}

/// Texture transform by glTF's conventions: scale, then turn, then move, about the bottom left
/// corner. assimp turns about the middle.
glm::mat3x2 transform_of(const aiUVTransform& t) {
  const auto c = float(std::cos(t.mRotation)), s = float(std::sin(t.mRotation));
  const vec2 scale(t.mScaling.x, t.mScaling.y), move(t.mTranslation.x, t.mTranslation.y);
  const glm::mat2 linear(c * scale.x, s * scale.x, -s * scale.y, c * scale.y);
  const vec2 middle(0.5f);
  const vec2 rest = glm::mat2(c, s, -s, c) * (move - middle) + middle;
  return {linear[0], linear[1], rest};
}

/// One material being read.
class Reader {
 public:
  Reader(const aiScene& scene, Builder& builder, TextureFiles& textures, const aiMaterial& material)
      : scene_(scene),
        builder_(builder),
        textures_(textures),
        material_(material),
        name_(clean_name(text_of(material.GetName()), "?")),
        is_tinted_(builder.format == "x") {}

  PutMaterial read() {
    PutMaterial put;
    colors(put);
    surface(put);
    opacity(put);
    put.normal_map = map({aiTextureType_NORMALS, aiTextureType_NORMAL_CAMERA}, false);
    if (material_.GetTextureCount(aiTextureType_HEIGHT) > 0)
      warn("has a bump map, which is left out");
    return put;
  }

 private:
  void warn(const std::string& what) {
    builder_.warn(fmt::format("material '{}' {}", name_, what));
  }

  std::optional<float> number(const char* key, u32 type = 0, u32 index = 0) const {
    float value = 0;
    if (material_.Get(key, type, index, value) != AI_SUCCESS || !std::isfinite(value)) return {};
    return value;
  }
  std::optional<vec3> color(const char* key, u32 type, u32 index) const {
    aiColor3D value;
    if (material_.Get(key, type, index, value) != AI_SUCCESS) return {};
    const vec3 out(value.r, value.g, value.b);
    if (!std::isfinite(out.x + out.y + out.z)) return {};
    return out;
  }
  static void set(PutMaterial& put, MaterialParameter p, vec3 value, float high = 1) {
    put.parameters[std::size_t(p)].value = glm::clamp(value, 0.0f, high);
  }

  /// The colour of a parameter that may have a map: most formats' maps replace it.
  vec3 factor(bool mapped, vec3 value) const {
    return mapped && (!is_tinted_ || value == vec3(0)) ? vec3(1) : value;
  }

  void colors(PutMaterial& put) {
    constexpr float kBrightest = 1e9f;
    const auto& base = map(put, base_color, {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE});
    auto diffuse = color(AI_MATKEY_BASE_COLOR);
    if (!diffuse) diffuse = color(AI_MATKEY_COLOR_DIFFUSE);
    set(put, base_color, factor(bool(base), diffuse.value_or(vec3(0.8f))));
    const auto& glow = map(put, emission, {aiTextureType_EMISSION_COLOR, aiTextureType_EMISSIVE});
    const vec3 emissive = color(AI_MATKEY_COLOR_EMISSIVE).value_or(vec3(0));
    const float strength = number(AI_MATKEY_EMISSIVE_INTENSITY).value_or(1);
    if (glow || emissive != vec3(0))
      set(put, emission, strength * factor(bool(glow), emissive), kBrightest);
  }

  void surface(PutMaterial& put) {
    const auto& rough = map(put, roughness, {aiTextureType_DIFFUSE_ROUGHNESS});
    const auto given = number(AI_MATKEY_ROUGHNESS_FACTOR);
    const auto shininess = number(AI_MATKEY_SHININESS);
    const float phong = shininess ? roughness_of(*shininess) : 0.5f;
    set(put, roughness, vec3(rough ? 1 : given.value_or(phong)));
    const auto& metal = map(put, metallic, {aiTextureType_METALNESS});
    auto metalness = number(AI_MATKEY_METALLIC_FACTOR);
    if (!metalness && is_of_blender()) metalness = number(AI_MATKEY_REFLECTIVITY);
    set(put, metallic, vec3(metal ? 1 : metalness.value_or(0)));
    const auto shine = color(AI_MATKEY_COLOR_SPECULAR);
    if (shine && !given && !is_of_blender()) set(put, specular, vec3(specular_of(*shine)));
    constexpr float kDensest = 4;
    const float index = number(AI_MATKEY_REFRACTI).value_or(0);
    if (index > 1) set(put, ior, vec3(index), kDensest);
  }

  /// Blender writes a metal's share as reflectivity, and a specular colour that is none.
  bool is_of_blender() const {
    aiString generator;
    return scene_.mMetaData && scene_.mMetaData->Get("SourceAsset_Generator", generator) &&
           text_of(generator).find("Blender") != std::string::npos;
  }

  void opacity(PutMaterial& put) {
    auto& texture = map(put, alpha, {aiTextureType_OPACITY});
    float visible = number(AI_MATKEY_OPACITY).value_or(1);
    if (visible <= 0) {
      warn("is wholly transparent and taken as opaque");
      visible = 1;
    }
    if (texture) texture->use.channel = textures_.opacity_channel(*texture);
    if (!texture && visible >= 1) return;
    put.alpha_mode = AlphaMode::kBlend;
    set(put, alpha, vec3(visible));
  }

  /// The first map of the first kind that there is.
  Boxed<TextureUsePatch> map(std::initializer_list<aiTextureType> kinds, bool srgb) {
    for (const aiTextureType kind : kinds) {
      const u32 count = material_.GetTextureCount(kind);
      if (count == 0) continue;
      if (count > 1) warn("has several maps of one kind: the first is taken");
      return use(kind, srgb);
    }
    return {};
  }
  /// Colours are sRGB.
  Boxed<TextureUsePatch>& map(PutMaterial& put, MaterialParameter p,
                              std::initializer_list<aiTextureType> kinds) {
    return put.parameters[std::size_t(p)].texture = map(kinds, p == base_color || p == emission);
  }

  Boxed<TextureUsePatch> use(aiTextureType kind, bool srgb) {
    aiString path;
    u32 uv_set = 0;
    std::array<aiTextureMapMode, 3> modes{aiTextureMapMode_Wrap, aiTextureMapMode_Wrap,
                                          aiTextureMapMode_Wrap};
    if (material_.GetTexture(kind, 0, &path, nullptr, &uv_set, nullptr, nullptr, modes.data()) !=
        AI_SUCCESS)
      return {};
    if (uv_set > 1) warn("has a map of a third set of texture coordinates: the first is taken");
    TextureFile file{.path = text_of(path),
                     .where = fmt::format("material '{}'", name_),
                     .srgb = srgb,
                     .wrap_u = wrap_of(modes[0]),
                     .wrap_v = wrap_of(modes[1])};
    if (const aiTexture* embedded = scene_.GetEmbeddedTexture(path.C_Str())) {
      if (embedded->mHeight != 0 || embedded->mWidth == 0) {
        warn("has a map of bare texels, which is left out");
        return {};
      }
      file.embedded = std::as_bytes(
          std::span(reinterpret_cast<const char*>(embedded->pcData), embedded->mWidth));
    } else {
      file.path = Bundle::companion(builder_.bundle.model().path, file.path, file.where);
    }
    if (file.path.empty()) return {};
    Boxed<TextureUsePatch> out = textures_.use(file);
    if (!out) return {};
    out->use.uv_set = uv_set == 1 ? 1 : 0;
    aiUVTransform transform;
    if (material_.Get(AI_MATKEY_UVTRANSFORM(kind, 0), transform) == AI_SUCCESS)
      out->use.uv_transform = transform_of(transform);
    return out;
  }

  const aiScene& scene_;
  Builder& builder_;
  TextureFiles& textures_;
  const aiMaterial& material_;
  const std::string name_;
  const bool is_tinted_;
};

/// The material that assimp makes for a file without one.
bool is_made_up(const aiMaterial& material, const std::string& format) {
  return format == "off" || text_of(material.GetName()) == AI_DEFAULT_MATERIAL_NAME;
}

}  // namespace

std::vector<Ref> load_materials(const aiScene& scene, Builder& builder) {
  std::vector<bool> used(scene.mNumMaterials);
  for (u32 i = 0; i < scene.mNumMeshes; ++i) used.at(scene.mMeshes[i]->mMaterialIndex) = true;
  TextureFiles textures(builder);
  std::vector<std::pair<u32, PutMaterial>> puts;
  for (u32 i = 0; i < scene.mNumMaterials; ++i) {
    const aiMaterial& material = *scene.mMaterials[i];
    if (!used[i] || is_made_up(material, builder.format)) continue;
    puts.emplace_back(i, Reader(scene, builder, textures, material).read());
  }
  std::vector<Ref> out(scene.mNumMaterials);
  if (!builder.complete()) return out;
  for (auto& [i, put] : puts) {
    const std::string name = text_of(scene.mMaterials[i]->GetName());
    out[i] = builder.library(builder.claim_name(name, "material"), std::move(put));
  }
  return out;
}

}  // namespace heliograph::assets::assimp
