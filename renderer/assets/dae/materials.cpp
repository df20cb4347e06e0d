// Source: COLLADA 1.5.0, chapter 8 (FX), profile_COMMON. Shininess and specular become roughness
// and specular as in MTL.
#include <algorithm>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/phong.h"
#include "renderer/assets/text_scan.h"
#include "renderer/assets/texture_files.h"

namespace heliograph::assets::dae {
namespace {

using enum MaterialParameter;

/// A colour or a texture, whichever the file gives.
struct Value {
  vec4 color{1};
  Boxed<TextureUsePatch> texture;
};

Wrap wrap_of(const Node& sampler, const char* key) {
  const std::string_view text = trimmed(sampler.child_value(key));
  if (text == "MIRROR") return Wrap::kMirror;
  return text.empty() || text == "WRAP" ? Wrap::kRepeat : Wrap::kClamp;
}

/// One <effect> being read.
class Reader {
 public:
  Reader(const Document& document, Builder& builder, TextureFiles& textures, const Node& effect)
      : document_(document),
        builder_(builder),
        textures_(textures),
        profile_(effect.child("profile_COMMON")) {
    const Node technique = profile_.child("technique");
    for (const char* model : {"phong", "lambert", "blinn", "constant"})
      if (!shading_) shading_ = technique.child(model);
    if (technique.find_node(
            [](const Node& node) { return std::string_view(node.name()) == "bump"; }))
      builder.warn("COLLADA bump maps are left out");
  }

  PutMaterial read() {
    PutMaterial put;
    const auto set = [&](MaterialParameter p, vec3 value, float low, float high) {
      put.parameters[std::size_t(p)].value = glm::clamp(value, low, high);
    };
    const bool shaded = shading_ && std::string_view(shading_.name()) != "constant";
    const Value diffuse = shaded ? value("diffuse", true).value_or(Value{}) : Value{vec4(0), {}};
    set(base_color, vec3(diffuse.color), 0, 1);
    put.parameters[std::size_t(base_color)].texture = diffuse.texture;
    if (const auto glow = value("emission", true)) {
      set(emission, vec3(glow->color), 0, 1e9f);
      put.parameters[std::size_t(emission)].texture = glow->texture;
    }
    const auto shininess = number("shininess");
    set(roughness, vec3(shininess ? roughness_of(*shininess) : 0.5f), 0, 1);
    set(metallic, vec3(0), 0, 1);
    if (const auto shine = value("specular", true); shine && !shine->texture)
      set(specular, vec3(specular_of(vec3(shine->color))), 0, 1);
    if (const auto index = number("index_of_refraction"); index && *index > 1)
      set(ior, vec3(*index), 1, 4);
    transparency(put);
    return put;
  }

 private:
  std::optional<float> number(const char* key) {
    const Node node = shading_.child(key).child("float");
    if (!node) return std::nullopt;
    return read_floats(node, 1, builder_.budget)[0];
  }

  std::optional<Value> value(const char* key, bool srgb) {
    const Node node = shading_.child(key);
    if (const Node color = node.child("color")) {
      std::vector<float> numbers = read_floats(color, builder_.budget);
      if (numbers.size() == 3) numbers.push_back(1);
      if (numbers.size() != 4) refuse(place(color), "a <color> needs 3 or 4 numbers");
      return Value{{numbers[0], numbers[1], numbers[2], numbers[3]}, {}};
    }
    if (const Node texture = node.child("texture")) {
      return Value{vec4(1), use(texture.attribute("texture").value(), srgb, place(texture))};
    }
    return std::nullopt;
  }

  Node parameter(std::string_view sid) const {
    return profile_.find_child_by_attribute("newparam", "sid", std::string(sid).c_str());
  }

  /// By a sampler and its surface, or by the image itself.
  Boxed<TextureUsePatch> use(std::string_view name, bool srgb, const std::string& where) {
    const Node sampler = parameter(name).child("sampler2D");
    Node image;
    if (const Node direct = sampler.child("instance_image")) {
      image = document_.linked(direct.attribute("url").value(), "image", where);
    } else {
      const Node surface = parameter(trimmed(sampler.child_value("source"))).child("surface");
      image = document_.find(sampler ? trimmed(surface.child_value("init_from")) : name, "image");
    }
    if (!image) {
      builder_.warn(fmt::format("{}: texture '{}' has no image and is left out", where,
                                clean_name(name, "?")));
      return {};
    }
    const Node from = image.child("init_from");
    std::string path(trimmed(from.child("ref") ? from.child_value("ref") : from.text().get()));
    const std::string inside = place(image);
    const std::string found =
        Bundle::companion(builder_.bundle.model().path, percent_decode(path, inside), inside);
    if (found.empty()) return {};
    return textures_.use({.path = found,
                          .where = inside,
                          .srgb = srgb,
                          .wrap_u = wrap_of(sampler, "wrap_s"),
                          .wrap_v = wrap_of(sampler, "wrap_t")});
  }

  /// Source: COLLADA 1.5.0, "Determining Transparency". Files that state that nothing is to be seen
  /// mean the opposite: exporters disagree about the sense of the number.
  void transparency(PutMaterial& put) {
    const auto transparent = value("transparent", false);
    const auto factor = number("transparency");
    if (!transparent && !factor) return;
    const std::string_view mode = shading_.child("transparent").attribute("opaque").value();
    const bool rgb = mode.starts_with("RGB");
    const bool zero = mode.ends_with("ZERO");
    const vec4 color = transparent ? transparent->color : vec4(rgb && zero ? 0.0f : 1.0f);
    const float luminance = glm::dot(vec3(color), vec3(0.212671f, 0.715160f, 0.072169f));
    const float share = (rgb ? luminance : color.w) * factor.value_or(1);
    const float opacity = std::clamp(zero ? 1 - share : share, 0.0f, 1.0f);
    const bool textured = transparent && transparent->texture;
    if (!textured && opacity <= 0)
      builder_.warn(fmt::format("{}: is wholly transparent and taken as opaque", place(shading_)));
    if (!textured && (opacity <= 0 || opacity >= 1)) return;
    put.alpha_mode = AlphaMode::kBlend;
    ParameterPatch& out = put.parameters[std::size_t(alpha)];
    out.value = vec3(textured ? factor.value_or(1) : opacity);
    if (!textured) return;
    out.texture = transparent->texture;
    out.texture->use.channel = rgb ? 0 : textures_.opacity_channel(*out.texture);
    if (!zero) return;
    out.texture->use.scale = -1;
    out.texture->use.offset = 1;
  }

  const Document& document_;
  Builder& builder_;
  TextureFiles& textures_;
  Node profile_, shading_;
};

}  // namespace

Materials load_materials(const Document& document, Builder& builder,
                         const std::vector<Node>& used) {
  TextureFiles textures(builder);
  std::vector<std::pair<std::string, PutMaterial>> puts;
  for (const Node& material : used) {
    const Node instance = material.child("instance_effect");
    const Node effect =
        document.linked(instance.attribute("url").value(), "effect", place(material));
    puts.emplace_back(builder.claim_name(name_of(material), "material"),
                      Reader(document, builder, textures, effect).read());
  }
  Materials out;
  if (!builder.complete()) return out;
  for (std::size_t i = 0; i < used.size(); ++i)
    out[used[i]] = builder.library(puts[i].first, std::move(puts[i].second));
  return out;
}

}  // namespace heliograph::assets::dae
