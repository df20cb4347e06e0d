// Parameters of a material, for Edits::material. docs/materials.md explains each.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "heliograph/pose.h"
#include "heliograph/ref.h"

namespace heliograph::client {

/// A texture that drives a parameter: (texel[channel] * scale + offset) * factor, looked up at
/// uv (u, v, 1).
struct TextureUse {
  Ref texture;
  Color factor{1};
  std::uint32_t channel = 0;  // 0..3, for scalar parameters
  double scale = 1;
  double offset = 0;
  std::uint32_t uv_set = 0;  // 0 or 1
  std::optional<Matrix<float, 2, 3>> uv{};

  TextureUse(Ref used) : texture(std::move(used)) {}
};

/// A constant, which unbinds a texture, or a texture with its factor.
struct ScalarParameter : std::variant<double, TextureUse> {
  ScalarParameter(double value) : variant(value) {}
  ScalarParameter(TextureUse use) : variant(std::move(use)) {}
  ScalarParameter(const Handle& texture) : variant(TextureUse(texture)) {}
};
struct ColorParameter : std::variant<Color, TextureUse> {
  ColorParameter(double grey) : variant(Color(grey)) {}
  ColorParameter(double r, double g, double b) : variant(Color(r, g, b)) {}
  ColorParameter(Color value) : variant(value) {}
  ColorParameter(TextureUse use) : variant(std::move(use)) {}
  ColorParameter(const Handle& texture) : variant(TextureUse(texture)) {}
};

enum class AlphaMode : int { kOpaque = 1, kMask = 2, kBlend = 3 };

/// Parameters that are set change, others stay; reset() goes back to the default. Units (metres,
/// turns, [0, 1]) and defaults are those of scene.proto, whose names these are.
class Parameters {
 public:
  using Value = std::variant<std::monostate, ScalarParameter, ColorParameter, TextureUse, bool,
                             double, std::int32_t, AlphaMode>;

  Parameters& base_color(const ColorParameter& v) { return set("base_color", v); }
  Parameters& metallic(const ScalarParameter& v) { return set("metallic", v); }
  Parameters& roughness(const ScalarParameter& v) { return set("roughness", v); }
  Parameters& specular(const ScalarParameter& v) { return set("specular", v); }
  Parameters& specular_color(const ColorParameter& v) { return set("specular_color", v); }
  Parameters& specular_tint(const ScalarParameter& v) { return set("specular_tint", v); }
  Parameters& ior(const ScalarParameter& v) { return set("ior", v); }
  Parameters& transmission(const ScalarParameter& v) { return set("transmission", v); }
  Parameters& transmission_roughness(const ScalarParameter& v) {
    return set("transmission_roughness", v);
  }
  Parameters& thin_walled(bool v) { return set("thin_walled", v); }
  Parameters& attenuation_color(const ColorParameter& v) { return set("attenuation_color", v); }
  Parameters& attenuation_distance(const ScalarParameter& v) {
    return set("attenuation_distance", v);
  }
  Parameters& medium_density(const ColorParameter& v) { return set("medium_density", v); }
  Parameters& medium_albedo(const ColorParameter& v) { return set("medium_albedo", v); }
  Parameters& medium_anisotropy(const ScalarParameter& v) { return set("medium_anisotropy", v); }
  Parameters& priority(std::int32_t v) { return set("priority", v); }
  Parameters& emission(const ColorParameter& v) { return set("emission", v); }
  Parameters& emission_strength(const ScalarParameter& v) { return set("emission_strength", v); }
  Parameters& two_sided_emission(bool v) { return set("two_sided_emission", v); }
  Parameters& unlit(bool v) { return set("unlit", v); }
  Parameters& alpha(const ScalarParameter& v) { return set("alpha", v); }
  Parameters& alpha_mode(AlphaMode v) { return set("alpha_mode", v); }
  Parameters& alpha_cutoff(double v) { return set("alpha_cutoff", v); }
  Parameters& normal_map(const TextureUse& v) { return set("normal_map", v); }
  Parameters& bump_map(const TextureUse& v) { return set("bump_map", v); }
  Parameters& subsurface(const ScalarParameter& v) { return set("subsurface", v); }
  Parameters& subsurface_radius(const ColorParameter& v) { return set("subsurface_radius", v); }
  Parameters& subsurface_color(const ColorParameter& v) { return set("subsurface_color", v); }
  Parameters& anisotropic(const ScalarParameter& v) { return set("anisotropic", v); }
  Parameters& anisotropic_rotation(const ScalarParameter& v) {
    return set("anisotropic_rotation", v);
  }
  Parameters& sheen(const ScalarParameter& v) { return set("sheen", v); }
  Parameters& sheen_color(const ColorParameter& v) { return set("sheen_color", v); }
  Parameters& sheen_roughness(const ScalarParameter& v) { return set("sheen_roughness", v); }
  Parameters& sheen_tint(const ScalarParameter& v) { return set("sheen_tint", v); }
  Parameters& clearcoat(const ScalarParameter& v) { return set("clearcoat", v); }
  Parameters& clearcoat_roughness(const ScalarParameter& v) {
    return set("clearcoat_roughness", v);
  }
  Parameters& clearcoat_normal_map(const TextureUse& v) { return set("clearcoat_normal_map", v); }
  Parameters& iridescence(const ScalarParameter& v) { return set("iridescence", v); }
  Parameters& iridescence_ior(const ScalarParameter& v) { return set("iridescence_ior", v); }
  Parameters& iridescence_thickness(const ScalarParameter& v) {
    return set("iridescence_thickness", v);
  }
  Parameters& diffuse_transmission(const ScalarParameter& v) {
    return set("diffuse_transmission", v);
  }
  Parameters& diffuse_transmission_color(const ColorParameter& v) {
    return set("diffuse_transmission_color", v);
  }
  Parameters& dispersion(const ScalarParameter& v) { return set("dispersion", v); }

  /// A parameter by its name goes back to its default.
  Parameters& reset(const std::string& name);

  [[nodiscard]] const std::vector<std::pair<std::string, Value>>& values() const { return values_; }

 private:
  Parameters& set(const std::string& name, const ScalarParameter& value);
  Parameters& set(const std::string& name, const ColorParameter& value);
  Parameters& set(const std::string& name, const TextureUse& value);
  Parameters& set(const std::string& name, bool value);
  Parameters& set(const std::string& name, double value);
  Parameters& set(const std::string& name, std::int32_t value);
  Parameters& set(const std::string& name, AlphaMode value);

  std::vector<std::pair<std::string, Value>> values_;
};

/// Bundled materials; any parameter may be changed: materials::plastic().base_color({1, 0, 0}).
namespace materials {
Parameters matte();
Parameters plaster();
Parameters plastic();
Parameters rubber();
Parameters wood();
Parameters steel();
Parameters aluminium();
Parameters gold();
Parameters copper();
Parameters chrome();
Parameters glass();
Parameters frosted_glass();
Parameters marble();
Parameters skin();
Parameters milk();
}  // namespace materials

}  // namespace heliograph::client
