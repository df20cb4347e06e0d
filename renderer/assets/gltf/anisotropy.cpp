// Source: KHR_materials_anisotropy. glTF stretches alpha to mix(alpha, 1, strength^2) along the
// tangent and leaves it across. Ours has the same ratio, as far as it goes, and the same geometric
// mean.
#include "renderer/assets/gltf/anisotropy.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace heliograph::assets::gltf {
namespace {

using enum MaterialParameter;

constexpr double kTurn = 2 * std::numbers::pi;

struct Stretched {
  double roughness, anisotropic;  // anisotropic above 1: beyond what ours reaches
};
Stretched stretched(double rough, double strength) {
  const double across = std::max(rough * rough, 1e-4);
  const double along = across + (1 - across) * strength * strength;
  return {std::min(std::pow(across * along, 0.25), 1.0), (1 - across / along) / 0.9};
}

double part_of_turn(double radians) {
  const double turns = radians / kTurn;
  return turns - std::floor(turns);
}

bool has_levels(const ImageData& image) {
  return image.type == TexelType::kU8 || image.type == TexelType::kU16;
}

/// The texel at (u, v) in [0, 1) of an image of 8 or 16 bits, as [0, 1].
double level(const ImageData& image, double u, double v, u32 channel) {
  const auto x = std::size_t(u * image.width);
  const auto y = std::size_t(v * image.height);
  const std::size_t i = (y * image.width + x) * image.channels + channel;
  const std::byte* bytes = image.texels->bytes().data();
  if (image.type == TexelType::kU8) return double(u8(bytes[i])) / 255;
  u16 value;
  std::memcpy(&value, bytes + 2 * i, sizeof value);
  return value / 65535.0;
}

/// A texture of 16 bits that is being filled, laid on the surface as another is.
class Baked {
 public:
  Baked(const ImageData& like, u32 channels, Budget& budget, const std::string& where)
      : image_{.width = like.width,
               .height = like.height,
               .channels = channels,
               .type = TexelType::kU16} {
    const u64 texels = u64(like.width) * like.height;
    budget.take(texels, u64(channels) * sizeof(u16), where);
    values_.reserve(texels * channels);
  }
  void add(double value) {
    values_.push_back(u16(std::lround(std::clamp(value, 0.0, 1.0) * 65535)));
  }

  Ref put(Builder& builder, PutTexture like, bool nearest) && {
    image_.texels = ArrayOf<u16>(std::move(values_)).buffer();
    like.image = std::make_shared<const ImageData>(std::move(image_));
    like.nearest = nearest;
    return builder.library(builder.claim_name("anisotropy", "anisotropy"), std::move(like));
  }

 private:
  ImageData image_;
  std::vector<u16> values_;
};

bool lies_alike(const TextureUse& a, const TextureUse& b) {
  return a.uv_set == b.uv_set && a.uv_transform == b.uv_transform;
}

class Baker {
 public:
  Baker(const Anisotropy& anisotropy, const Textures& textures, Builder& builder, PutMaterial& put)
      : anisotropy_(anisotropy), textures_(textures), builder_(builder), put_(put) {}

  void constants() {
    const Stretched whole = stretched(factor_, anisotropy_.strength);
    set(anisotropic, std::min(whole.anisotropic, 1.0));
    set(roughness, whole.roughness);
    set(anisotropic_rotation, part_of_turn(anisotropy_.rotation));
    warn_capped(whole.anisotropic);
  }

  void bake() {
    const ImageData& image = *textures_.image(*anisotropy_.texture);
    if (image.channels < 3 || !has_levels(image) || !has_roughness_beside()) return leave_out();
    Baked shape(image, 2, builder_.budget, anisotropy_.where);
    Baked turns(image, 1, builder_.budget, anisotropy_.where);
    double most = 0;
    for (u32 y = 0; y < image.height; ++y) {
      for (u32 x = 0; x < image.width; ++x) {
        const double u = (x + 0.5) / image.width;
        const double v = (y + 0.5) / image.height;
        const Stretched one =
            stretched(roughness_at(u, v), anisotropy_.strength * level(image, u, v, 2));
        const double angle =
            std::atan2(2 * level(image, u, v, 1) - 1, 2 * level(image, u, v, 0) - 1);
        shape.add(one.roughness);
        shape.add(one.anisotropic);
        turns.add(part_of_turn(anisotropy_.rotation + angle));
        most = std::max(most, one.anisotropic);
      }
    }
    const PutTexture like = textures_.layout(*anisotropy_.texture);
    const Ref both = std::move(shape).put(builder_, like, like.nearest.value_or(false));
    use_texture(roughness, both, 0);
    use_texture(anisotropic, both, 3);  // the second of two channels is alpha
    // Angles of a whole turn and of none are one direction, and their mean is the opposite one.
    use_texture(anisotropic_rotation, std::move(turns).put(builder_, like, true), 0);
    warn_capped(most);
  }

 private:
  /// True if the roughness is the same everywhere, or lies on the surface as the anisotropy does.
  bool has_roughness_beside() {
    const auto& rough = parameter(roughness).texture;
    return !rough || (has_levels(*textures_.image(*rough)) &&
                      lies_alike(rough->use, anisotropy_.texture->use));
  }
  double roughness_at(double u, double v) {
    const auto& rough = parameter(roughness).texture;
    if (!rough) return factor_;
    const TextureUse& use = rough->use;
    return factor_ * (level(*textures_.image(*rough), u, v, use.channel) * use.scale + use.offset);
  }
  ParameterPatch& parameter(MaterialParameter p) { return put_.parameters[std::size_t(p)]; }
  void set(MaterialParameter p, double value) { parameter(p).value = vec3(float(value)); }
  void use_texture(MaterialParameter p, const Ref& texture, u32 channel) {
    set(p, 1);
    TextureUse use = anisotropy_.texture->use;
    use.channel = channel;
    parameter(p).texture = TextureUsePatch{.texture = texture, .use = use};
  }
  void leave_out() {
    builder_.warn(
        fmt::format("{}: the anisotropy texture is left out: it has fewer than 3 "
                    "channels, or floats, or lies otherwise than the roughness texture",
                    anisotropy_.where));
    constants();
  }
  void warn_capped(double most) {
    if (most <= 1.0001) return;
    builder_.warn(fmt::format("{}: anisotropy is stretched by 10 at most, the file says {:.0f}",
                              anisotropy_.where, 1 / (1 - 0.9 * most)));
  }

  const Anisotropy& anisotropy_;
  const Textures& textures_;
  Builder& builder_;
  PutMaterial& put_;
  const double factor_ = parameter(roughness).value->x;
};

}  // namespace

Anisotropy read_anisotropy(const Value& brushed, Textures& textures) {
  Anisotropy anisotropy{.where = brushed.where(),
                        .strength = std::clamp(brushed.number("anisotropyStrength", 0), 0.0, 1.0),
                        .rotation = brushed.number("anisotropyRotation", 0),
                        .texture = {}};
  if (const auto info = brushed.find("anisotropyTexture"))
    anisotropy.texture = textures.use(*info, false, 2);
  return anisotropy;
}

void apply_anisotropy(const Anisotropy& anisotropy, const Textures& textures, Builder& builder,
                      PutMaterial& put) {
  Baker baker(anisotropy, textures, builder, put);
  if (anisotropy.texture) {
    baker.bake();
  } else {
    baker.constants();
  }
}

}  // namespace heliograph::assets::gltf
