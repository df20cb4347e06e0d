// Source: glTF 2.0, 3.9 (Materials) and the KHR_materials_* extensions it cites by name.
#include "renderer/assets/gltf/materials.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "renderer/assets/gltf/anisotropy.h"

namespace heliograph::assets::gltf {
namespace {

using enum MaterialParameter;

struct Range {
  float smallest, largest;
};
constexpr std::array<Range, kMaterialParameters> kRanges = {{
#define HELIO_PARAMETER(name, components, initial, smallest, largest) {smallest, largest},
    HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
}};

/// One material being read.
class Reader {
 public:
  Reader(const Value& value, Textures& textures, Builder& builder)
      : value_(value), textures_(textures), builder_(builder) {}

  /// `anisotropy` is applied later, when pictures are decoded.
  struct Result {
    PutMaterial put;
    std::optional<Anisotropy> anisotropy;
  };

  Result read() {
    alpha();
    if (const auto old = value_.extension("KHR_materials_pbrSpecularGlossiness")) {
      specular_glossiness(*old);
    } else {
      metallic_roughness();
    }
    emission();
    extensions();
    put_.normal_map = normal_map(value_, "normalTexture");
    put_.two_sided_emission = value_.flag("doubleSided", false);
    return {.put = std::move(put_), .anisotropy = std::move(anisotropy_)};
  }

 private:
  void set(MaterialParameter parameter, vec3 value) {
    const Range range = kRanges[std::size_t(parameter)];
    const vec3 clamped = glm::clamp(value, range.smallest, range.largest);
    if (clamped != value) {
      builder_.warn(fmt::format("{}: a factor outside [{}, {}] was clamped", value_.where(),
                                range.smallest, range.largest));
    }
    put_.parameters[std::size_t(parameter)].value = clamped;
  }
  void set(MaterialParameter parameter, const Value& owner, const std::string& key,
           double fallback) {
    set(parameter, vec3(float(owner.number(key, fallback))));
  }
  void set_texture(MaterialParameter parameter, const Value& owner, const std::string& key,
                   bool srgb, u32 channel) {
    const auto info = owner.find(key);
    if (info) put_.parameters[std::size_t(parameter)].texture = textures_.use(*info, srgb, channel);
  }

  Boxed<TextureUsePatch> normal_map(const Value& owner, const std::string& key) {
    const auto info = owner.find(key);
    if (!info) return {};
    auto map = textures_.use(*info, false, 0);
    if (map) map->use.scale = float(info->number("scale", 1));
    return map;
  }

  void alpha() {
    const std::string mode = value_.text("alphaMode", "OPAQUE");
    if (mode == "OPAQUE") {
      put_.alpha_mode = AlphaMode::kOpaque;
    } else if (mode == "MASK") {
      put_.alpha_mode = AlphaMode::kMask;
      put_.alpha_cutoff = float(std::clamp(value_.number("alphaCutoff", 0.5), 0.0, 1.0));
    } else if (mode == "BLEND") {
      put_.alpha_mode = AlphaMode::kBlend;
    } else {
      refuse(value_.key_where("alphaMode"), "must be OPAQUE, MASK or BLEND");
    }
  }
  /// base_color from RGB of a factor and a texture, alpha from their A unless the mode is OPAQUE.
  void color_and_alpha(const Value& owner, const std::string& factor, const std::string& texture) {
    const auto color = owner.numbers(factor, vec4(1));
    set(base_color, vec3(color));
    set_texture(base_color, owner, texture, true, 0);
    if (put_.alpha_mode == AlphaMode::kOpaque) return;
    set(MaterialParameter::alpha, vec3(color.w));
    set_texture(MaterialParameter::alpha, owner, texture, true, 3);
  }

  void metallic_roughness() {
    static const nlohmann::json kEmpty = nlohmann::json::object();
    const Value pbr = value_.find("pbrMetallicRoughness").value_or(Value(kEmpty, value_.where()));
    color_and_alpha(pbr, "baseColorFactor", "baseColorTexture");
    set(metallic, pbr, "metallicFactor", 1);
    set(roughness, pbr, "roughnessFactor", 1);
    set_texture(metallic, pbr, "metallicRoughnessTexture", false, 2);
    set_texture(roughness, pbr, "metallicRoughnessTexture", false, 1);
  }

  /// Diffuse and specular of a dielectric: F0 = 0.04 specular_color, so the tint is specular /
  /// 0.04.
  void specular_glossiness(const Value& old) {
    color_and_alpha(old, "diffuseFactor", "diffuseTexture");
    set(metallic, vec3(0));
    set(specular_color, old.numbers("specularFactor", vec3(1)) / 0.04f);
    set_texture(specular_color, old, "specularGlossinessTexture", true, 0);
    const float glossiness = float(std::clamp(old.number("glossinessFactor", 1), 0.0, 1.0));
    ParameterPatch& rough = put_.parameters[std::size_t(roughness)];
    set_texture(roughness, old, "specularGlossinessTexture", true, 3);
    set(roughness, vec3(rough.texture ? 1.0f : 1.0f - glossiness));
    if (rough.texture) {
      rough.texture->use.scale = -glossiness;
      rough.texture->use.offset = 1;
    }
  }

  void emission() {
    const auto factor = value_.numbers("emissiveFactor", vec3(0));
    set(MaterialParameter::emission, factor);
    if (glm::any(glm::greaterThan(factor, vec3(0))))
      set_texture(MaterialParameter::emission, value_, "emissiveTexture", true, 0);
    if (const auto strength = value_.extension("KHR_materials_emissive_strength"))
      set(emission_strength, *strength, "emissiveStrength", 1);
  }

  void extensions() {
    put_.unlit = value_.extension("KHR_materials_unlit").has_value();
    if (const auto transmitting = value_.extension("KHR_materials_transmission")) {
      set(transmission, *transmitting, "transmissionFactor", 0);
      set_texture(transmission, *transmitting, "transmissionTexture", false, 0);
      volume();
    }
    if (const auto leaf = value_.extension("KHR_materials_diffuse_transmission")) passing(*leaf);
    if (const auto split = value_.extension("KHR_materials_dispersion"))
      set(dispersion, *split, "dispersion", 0);
    if (const auto coat = value_.extension("KHR_materials_clearcoat")) clearcoating(*coat);
    if (const auto cloth = value_.extension("KHR_materials_sheen")) sheen_of(*cloth);
    if (const auto brushed = value_.extension("KHR_materials_anisotropy")) {
      anisotropy_ = read_anisotropy(*brushed, textures_);
      const double strength = brushed->number("anisotropyStrength", 0);
      if (strength < 0 || strength > 1)
        builder_.warn(fmt::format("{}: a strength outside [0, 1] was clamped", brushed->where()));
    }
    if (const auto film = value_.extension("KHR_materials_iridescence")) thin_film(*film);
    if (const auto index = value_.extension("KHR_materials_ior")) set(ior, *index, "ior", 1.5);
    if (const auto reflecting = value_.extension("KHR_materials_specular")) {
      set(specular, *reflecting, "specularFactor", 1);
      set_texture(specular, *reflecting, "specularTexture", false, 3);
      set(specular_color, reflecting->numbers("specularColorFactor", vec3(1)));
      set_texture(specular_color, *reflecting, "specularColorTexture", true, 0);
    }
  }

  /// Without a thickness a transmitting surface is a thin sheet. With one the mesh itself shows how
  /// far light travels inside.
  void volume() {
    const auto inside = value_.extension("KHR_materials_volume");
    put_.thin_walled = !inside || !(inside->number("thicknessFactor", 0) > 0);
    if (*put_.thin_walled) return;
    const double infinite = std::numeric_limits<double>::infinity();
    const double distance = inside->number("attenuationDistance", infinite);
    if (!(distance > 0 && distance < kFarthest)) return;
    set(attenuation_color, inside->numbers("attenuationColor", vec3(1)));
    set(attenuation_distance, vec3(float(distance)));
  }
  static constexpr double kFarthest = 1e9;     // of attenuation_distance, metres
  static constexpr float kLeastSheen = 0.25f;  // of the model, see docs/materials.md

  void passing(const Value& leaf) {
    set(diffuse_transmission, leaf, "diffuseTransmissionFactor", 0);
    set_texture(diffuse_transmission, leaf, "diffuseTransmissionTexture", false, 3);
    set(diffuse_transmission_color, leaf.numbers("diffuseTransmissionColorFactor", vec3(1)));
    set_texture(diffuse_transmission_color, leaf, "diffuseTransmissionColorTexture", true, 0);
    volume();
  }

  void clearcoating(const Value& coat) {
    set(clearcoat, coat, "clearcoatFactor", 0);
    set_texture(clearcoat, coat, "clearcoatTexture", false, 0);
    set(clearcoat_roughness, coat, "clearcoatRoughnessFactor", 0);
    set_texture(clearcoat_roughness, coat, "clearcoatRoughnessTexture", false, 1);
    put_.clearcoat_normal_map = normal_map(coat, "clearcoatNormalTexture");
  }

  void sheen_of(const Value& cloth) {
    const auto color = cloth.numbers("sheenColorFactor", vec3(0));
    set(sheen, vec3(1));
    set(sheen_color, color);
    set_texture(sheen_color, cloth, "sheenColorTexture", true, 0);
    const auto spread = float(cloth.number("sheenRoughnessFactor", 0));
    set(sheen_roughness, vec3(spread));
    if (spread < kLeastSheen && glm::any(glm::greaterThan(color, vec3(0)))) {
      builder_.warn(fmt::format("{}: a sheen roughness of {:.3g} acts as {}", value_.where(),
                                spread, kLeastSheen));
    }
    set_texture(sheen_roughness, cloth, "sheenRoughnessTexture", false, 3);
  }

  /// A texture mixes two thicknesses [nm]; without one the film has the maximum.
  void thin_film(const Value& film) {
    set(iridescence, film, "iridescenceFactor", 0);
    set_texture(iridescence, film, "iridescenceTexture", false, 0);
    set(iridescence_ior, film, "iridescenceIor", 1.3);
    const auto minimum = float(film.number("iridescenceThicknessMinimum", 100));
    const auto maximum = float(film.number("iridescenceThicknessMaximum", 400));
    set_texture(iridescence_thickness, film, "iridescenceThicknessTexture", false, 1);
    ParameterPatch& thickness = put_.parameters[std::size_t(iridescence_thickness)];
    const float largest = thickness.texture ? std::max(minimum, maximum) : maximum;
    set(iridescence_thickness, vec3(largest));
    if (!thickness.texture || !(largest > 0)) return;
    thickness.texture->use.scale = (maximum - minimum) / largest;
    thickness.texture->use.offset = minimum / largest;
  }

  const Value& value_;
  Textures& textures_;
  Builder& builder_;
  PutMaterial put_;
  std::optional<Anisotropy> anisotropy_;
};

/// Points channels at what the decoded image has: gray serves for red, green and blue; without an
/// alpha channel alpha is 1.
void adapt_channels(PutMaterial& put, const Textures& textures) {
  for (ParameterPatch& parameter : put.parameters) {
    if (!parameter.texture) continue;
    TextureUse& use = parameter.texture->use;
    const u32 channels = textures.image(*parameter.texture)->channels;
    if (use.channel == 3) {
      if (channels == 2 || channels == 4) continue;  // both have it there
      const float constant = use.scale + use.offset;
      parameter.texture.reset();
      parameter.value = parameter.value.value_or(vec3(1)) * constant;
    } else if (channels < 3) {
      use.channel = 0;
    }
  }
}

/// True if a normal map or stretched highlights lie along the first texture coordinates. Normal
/// maps of the second take the tangents of triangles.
bool wants_tangents(const Reader::Result& read) {
  const auto is_first = [](const Boxed<TextureUsePatch>& map) {
    return map && map->use.uv_set == 0;
  };
  return is_first(read.put.normal_map) || is_first(read.put.clearcoat_normal_map) ||
         (read.anisotropy && read.anisotropy->strength > 0);
}

}  // namespace

Materials load_materials(Document& document, Builder& builder, bool needs_fallback) {
  Textures textures(document, builder);
  std::vector<Reader::Result> read;
  Materials materials;
  for (const Value& material : document.items("materials"))
    read.push_back(Reader(material, textures, builder).read());
  for (const Reader::Result& material : read)
    materials.wants_tangents.push_back(wants_tangents(material));
  std::vector<std::string> names;  // before the textures', which nobody addresses
  for (const Value& material : document.items("materials"))
    names.push_back(
        builder.claim_name(material.text("name", ""), fmt::format("material_{}", names.size())));
  textures.make_library();
  if (!builder.complete()) return materials;
  for (u32 i = 0; i < read.size(); ++i) {
    adapt_channels(read[i].put, textures);
    if (read[i].anisotropy) apply_anisotropy(*read[i].anisotropy, textures, builder, read[i].put);
    materials.refs.push_back(builder.library(names[i], std::move(read[i].put)));
  }
  if (needs_fallback) {
    static const nlohmann::json kDefault = nlohmann::json::object();
    const Value value(kDefault, "materials");
    materials.fallback = builder.library(builder.claim_name("default", "default"),
                                         Reader(value, textures, builder).read().put);
  }
  return materials;
}

}  // namespace heliograph::assets::gltf
