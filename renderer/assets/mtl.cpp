#include "renderer/assets/mtl.h"

#include <algorithm>

#include "renderer/assets/text_scan.h"
#include "renderer/assets/texture_files.h"

namespace heliograph::assets {
namespace {

/// map_Kd [-options] file
struct Map {
  std::string path;
  std::string where;
  bool clamp = false;
  float strength = 1;  // -bm
  vec2 scale{1, 1}, offset{0, 0};
};

struct Entry {
  std::string name;
  vec3 kd{0.8f}, ke{0};
  std::optional<vec3> ks;
  std::optional<float> ns, pr, pm, ni;
  float alpha = 1;
  std::optional<Map> map_kd, map_ke, map_d, map_pr, map_pm, normal;
};

vec2 take_pair(std::string_view& text, vec2 fallback) {
  for (int i = 0; i < 3; ++i) {
    std::string_view ahead = text;
    const auto value = parse_number(take_word(ahead));
    if (!value) break;
    if (i < 2) fallback[i] = *value;
    text = ahead;
  }
  return fallback;
}

class Parser {
 public:
  Parser(Builder& builder, const std::string& file) : builder_(builder), file_(file) {}

  void parse(std::string_view text, std::vector<Entry>& entries) {
    Lines lines(text);
    while (auto line = lines.next()) {
      where_ = file_ + " " + lines.where();
      const std::string_view key = take_word(*line);
      if (key.empty() || key.starts_with('#')) continue;
      if (key == "newmtl") {
        entries.push_back({.name = std::string(trimmed(*line))});
      } else if (!entries.empty()) {
        statement(key, *line, entries.back());
      }
    }
  }

 private:
  vec3 color(std::string_view rest) {
    const float r = take_number(rest, where_);
    if (trimmed(rest).empty()) return vec3(r);
    const float g = take_number(rest, where_);
    return {r, g, take_number(rest, where_)};
  }
  float number(std::string_view rest) { return take_number(rest, where_); }

  Map map(std::string_view rest) {
    Map result;
    while (trimmed(rest).starts_with('-')) {
      const std::string_view option = take_word(rest);
      if (option == "-s") {
        result.scale = take_pair(rest, result.scale);
      } else if (option == "-o") {
        result.offset = take_pair(rest, result.offset);
      } else if (option == "-t") {
        (void)take_pair(rest, {});
      } else if (option == "-bm") {
        result.strength = take_number(rest, where_);
      } else if (option == "-mm") {
        (void)take_pair(rest, {});
      } else {
        const std::string_view value = take_word(rest);
        if (option == "-clamp") result.clamp = value == "on";
      }
    }
    std::string path(trimmed(rest));
    std::ranges::replace(path, '\\', '/');
    result.where = where_;
    result.path = Bundle::resolve(file_, path, where_);
    return result;
  }

  void statement(std::string_view key, std::string_view rest, Entry& entry) {
    if (key == "Kd") entry.kd = color(rest);
    if (key == "Ks") entry.ks = color(rest);
    if (key == "Ke") entry.ke = color(rest);
    if (key == "Ns") entry.ns = number(rest);
    if (key == "Ni") entry.ni = number(rest);
    if (key == "Pr") entry.pr = number(rest);
    if (key == "Pm") entry.pm = number(rest);
    if (key == "d" && !trimmed(rest).starts_with("-halo")) entry.alpha = number(rest);
    if (key == "Tr") entry.alpha = 1 - number(rest);
    if (key == "map_Kd") entry.map_kd = map(rest);
    if (key == "map_Ke") entry.map_ke = map(rest);
    if (key == "map_d") entry.map_d = map(rest);
    if (key == "map_Pr") entry.map_pr = map(rest);
    if (key == "map_Pm") entry.map_pm = map(rest);
    if (key == "norm") entry.normal = map(rest);
    for (const std::string_view left_out :
         {"map_Ks", "map_Ns", "map_Bump", "map_bump", "bump", "disp", "refl"}) {
      if (key == left_out) builder_.warn(fmt::format("MTL {} is left out", left_out));
    }
  }

  Builder& builder_;
  const std::string& file_;
  std::string where_;
};

class Maker {
 public:
  explicit Maker(Builder& builder) : textures_(builder) {}

  /// Textures go to the library here, materials after all of them.
  PutMaterial make(const Entry& entry) {
    PutMaterial put;
    const auto set = [&](MaterialParameter p, vec3 value, float low, float high) {
      put.parameters[std::size_t(p)].value = glm::clamp(value, low, high);
    };
    using enum MaterialParameter;
    const bool black_under_map = entry.map_kd && entry.kd == vec3(0);
    set(base_color, black_under_map ? vec3(1) : entry.kd, 0, 1);
    set(emission, entry.map_ke && entry.ke == vec3(0) ? vec3(1) : entry.ke, 0, 1e9f);
    const float shininess = std::max(entry.ns.value_or(0), 0.0f);
    const float from_ns = std::pow(2 / (shininess + 2), 0.25f);
    set(roughness, vec3(entry.map_pr ? 1 : entry.pr.value_or(entry.ns ? from_ns : 0.5f)), 0, 1);
    set(metallic, vec3(entry.map_pm ? 1 : entry.pm.value_or(0)), 0, 1);
    if (entry.ks) set(specular, vec3(2 * (entry.ks->x + entry.ks->y + entry.ks->z) / 3), 0, 1);
    if (entry.ni) set(ior, vec3(*entry.ni), 1, 4);
    if (entry.alpha < 1 || entry.map_d) put.alpha_mode = AlphaMode::kBlend;
    if (put.alpha_mode) set(alpha, vec3(entry.alpha), 0, 1);
    use(put.parameters[std::size_t(base_color)].texture, entry.map_kd, true);
    use(put.parameters[std::size_t(emission)].texture, entry.map_ke, true);
    use(put.parameters[std::size_t(roughness)].texture, entry.map_pr, false);
    use(put.parameters[std::size_t(metallic)].texture, entry.map_pm, false);
    use(put.parameters[std::size_t(alpha)].texture, entry.map_d, false);
    use(put.normal_map, entry.normal, false);
    if (put.normal_map) put.normal_map->use.scale = entry.normal->strength;
    if (auto& opacity = put.parameters[std::size_t(alpha)].texture)
      opacity->use.channel = textures_.opacity_channel(*opacity);
    return put;
  }

 private:
  void use(Boxed<TextureUsePatch>& out, const std::optional<Map>& map, bool srgb) {
    if (!map) return;
    const Wrap wrap = map->clamp ? Wrap::kClamp : Wrap::kRepeat;
    out = textures_.use({map->path, map->where, srgb, wrap, wrap});
    if (out)
      out->use.uv_transform = {map->scale.x, 0, 0, map->scale.y, map->offset.x, map->offset.y};
  }

  TextureFiles textures_;
};

}  // namespace

std::map<std::string, Ref> load_materials(Builder& builder, const std::vector<std::string>& files,
                                          const std::set<std::string>& used) {
  std::vector<Entry> entries;
  for (const std::string& path : files) {
    const BundleFile* file = builder.bundle.find(path);
    if (!file) {
      builder.missing(path);
      continue;
    }
    Parser(builder, path).parse(as_text(file->bytes), entries);
  }
  std::erase_if(entries, [&](const Entry& entry) { return !used.contains(entry.name); });
  Maker maker(builder);
  std::vector<std::pair<std::string, PutMaterial>> puts;
  std::vector<std::string> names;
  for (const Entry& entry : entries) {
    names.push_back(builder.claim_name(entry.name, "material"));
    puts.emplace_back(entry.name, maker.make(entry));
  }
  std::map<std::string, Ref> refs;
  if (!builder.complete()) return refs;
  for (std::size_t i = 0; i < puts.size(); ++i) {
    refs[puts[i].first] = builder.library(names[i], std::move(puts[i].second));
  }
  for (const std::string& name : used) {
    if (name.empty() || refs.contains(name)) continue;
    builder.warn(fmt::format("material '{}' is defined nowhere; the default is used",
                             clean_name(name, "?")));
  }
  return refs;
}

}  // namespace heliograph::assets
