#include "renderer/assets/mtl.h"

#include <algorithm>
#include <array>

#include "renderer/assets/phong.h"
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
  vec3 ke{0};
  std::optional<vec3> kd, ks;
  std::optional<float> ns, pr, pm, ni, d, tr;
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
  /// r, or r g b; nullopt: others, left out with a warning.
  std::optional<vec3> color(std::string_view statement) {
    std::string_view rest = statement;
    const auto r = parse_number(take_word(rest));
    if (r && trimmed(rest).empty()) return vec3(*r);
    const auto g = parse_number(take_word(rest)), b = parse_number(take_word(rest));
    if (r && g && b) return vec3(*r, *g, *b);
    warn_of_numbers(statement);
    return std::nullopt;
  }
  std::optional<float> number(std::string_view statement) {
    std::string_view rest = statement;
    const auto value = parse_number(take_word(rest));
    if (!value) warn_of_numbers(statement);
    return value;
  }
  void warn_of_numbers(std::string_view statement) {
    builder_.warn(fmt::format("{}: '{}' is no number, or not as many as it takes: left out", where_,
                              clean_text(trimmed(statement), 40)));
  }

  /// Reads what follows one option.
  void option(std::string_view name, std::string_view& rest, Map& out) {
    if (name == "-s") {
      out.scale = take_pair(rest, out.scale);
    } else if (name == "-o") {
      out.offset = take_pair(rest, out.offset);
    } else if (name == "-t" || name == "-mm") {
      (void)take_pair(rest, {});
    } else if (name == "-bm") {
      out.strength = take_number(rest, where_);
    } else {
      const std::string_view value = take_word(rest);
      if (name == "-clamp") out.clamp = value == "on";
    }
  }

  /// Some programs write options behind the name. nullopt: no name.
  std::optional<Map> map(std::string_view rest) {
    Map result{.path = "", .where = where_};
    rest = rest.substr(0, rest.find(" # "));
    while (trimmed(rest).starts_with('-')) {
      const std::string_view name = take_word(rest);
      option(name, rest, result);
    }
    std::string_view behind = rest.substr(std::min(start_of_options(rest), rest.size()));
    const std::string_view name = trimmed(rest.substr(0, rest.size() - behind.size()));
    while (!trimmed(behind).empty()) {
      const std::string_view word = take_word(behind);
      option(word, behind, result);
    }
    result.path = Bundle::companion(file_, name, where_);
    return result.path.empty() ? std::nullopt : std::optional(result);
  }

  /// "-halo": more opaque towards the rim, which is left out.
  std::string_view without_halo(std::string_view rest) {
    constexpr std::string_view kHalo = "-halo";
    rest = trimmed(rest);
    if (!rest.starts_with(kHalo)) return rest;
    builder_.warn("MTL d -halo is taken as d");
    return rest.substr(kHalo.size());
  }

  static std::size_t start_of_options(std::string_view rest) {
    std::size_t first = rest.npos;
    for (const std::string_view option : {"-s", "-o", "-t", "-mm", "-bm", "-clamp", "-blendu",
                                          "-blendv", "-boost", "-texres", "-imfchan", "-type"})
      first = std::min(first, rest.find(fmt::format(" {} ", option)));
    return first;
  }

  /// Programs disagree about the case of keys.
  void statement(std::string_view given, std::string_view rest, Entry& entry) {
    const std::string key = lower(given);
    if (key == "kd") entry.kd = color(rest);
    if (key == "ks") entry.ks = color(rest);
    if (key == "ke") entry.ke = color(rest).value_or(vec3(0));
    if (key == "ns") entry.ns = number(rest);
    if (key == "ni") entry.ni = number(rest);
    if (key == "pr") entry.pr = number(rest);
    if (key == "pm") entry.pm = number(rest);
    if (key == "d") entry.d = number(without_halo(rest));
    if (key == "tr") entry.tr = number(rest);
    if (key == "map_kd") entry.map_kd = map(rest);
    if (key == "map_ke") entry.map_ke = map(rest);
    if (key == "map_d") entry.map_d = map(rest);
    if (key == "map_pr") entry.map_pr = map(rest);
    if (key == "map_pm") entry.map_pm = map(rest);
    if (key == "norm") entry.normal = map(rest);
    constexpr std::array<std::string_view, 15> kRead = {
        "kd", "ks",     "ke",     "ns",    "ni",     "pr",     "pm",  "d",
        "tr", "map_kd", "map_ke", "map_d", "map_pr", "map_pm", "norm"};
    constexpr std::array<std::string_view, 6> kUnseen = {"illum", "ka",        "map_ka",
                                                         "tf",    "sharpness", "map_aat"};
    if (std::ranges::find(kRead, key) == kRead.end() &&
        std::ranges::find(kUnseen, key) == kUnseen.end())
      builder_.warn(fmt::format("MTL {} is left out", clean_name(given, "?")));
  }

  Builder& builder_;
  const std::string& file_;
  std::string where_;
};

class Maker {
 public:
  explicit Maker(Builder& builder) : builder_(builder), textures_(builder) {}

  /// Textures go to the library here, materials after all of them.
  PutMaterial make(const Entry& entry) {
    PutMaterial put;
    const auto set = [&](MaterialParameter p, vec3 value, float low, float high) {
      put.parameters[std::size_t(p)].value = glm::clamp(value, low, high);
    };
    using enum MaterialParameter;
    const vec3 kd = entry.kd.value_or(vec3(entry.map_kd ? 1 : 0.8f));
    set(base_color, entry.map_kd && kd == vec3(0) ? vec3(1) : kd, 0, 1);
    set(emission, entry.map_ke && entry.ke == vec3(0) ? vec3(1) : entry.ke, 0, 1e9f);
    const float from_ns = roughness_of(entry.ns.value_or(0));
    set(roughness, vec3(entry.map_pr ? 1 : entry.pr.value_or(entry.ns ? from_ns : 0.5f)), 0, 1);
    set(metallic, vec3(entry.map_pm ? 1 : entry.pm.value_or(0)), 0, 1);
    if (entry.ks) set(specular, vec3(specular_of(*entry.ks)), 0, 1);
    if (entry.ni) set(ior, vec3(*entry.ni), 1, 4);
    const float visible = opacity_of(entry);
    if (visible < 1 || entry.map_d) put.alpha_mode = AlphaMode::kBlend;
    if (put.alpha_mode) set(alpha, vec3(visible), 0, 1);
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
  /// `d` goes before `Tr`. Programs disagree about the sense of the latter, and none means that
  /// nothing is to be seen.
  float opacity_of(const Entry& entry) {
    if (entry.d && *entry.d <= 0)
      builder_.warn(fmt::format("material '{}' is invisible: d 0", clean_name(entry.name, "?")));
    if (entry.d || !entry.tr) return entry.d.value_or(1);
    if (*entry.tr < 1) return 1 - *entry.tr;
    builder_.warn(fmt::format("material '{}' has Tr 1 and no d, and is taken as opaque",
                              clean_name(entry.name, "?")));
    return 1;
  }

  void use(Boxed<TextureUsePatch>& out, const std::optional<Map>& map, bool srgb) {
    if (!map) return;
    const Wrap wrap = map->clamp ? Wrap::kClamp : Wrap::kRepeat;
    out = textures_.use({map->path, map->where, srgb, wrap, wrap});
    if (out)
      out->use.uv_transform = {map->scale.x, 0, 0, map->scale.y, map->offset.x, map->offset.y};
  }

  Builder& builder_;
  TextureFiles textures_;
};

}  // namespace

std::map<std::string, Ref> load_materials(Builder& builder, const std::vector<std::string>& files,
                                          const std::set<std::string>& used) {
  std::vector<Entry> entries;
  bool any_missing = false;
  for (const std::string& path : files) {
    const BundleFile* file = builder.bundle.find(path);
    if (file) {
      Parser(builder, path).parse(as_text(file->bytes), entries);
    } else {
      any_missing = true;
      builder.missing(path);
    }
  }
  const bool names_none = used == std::set<std::string>{""};
  const std::string only = names_none && entries.size() == 1 ? entries[0].name : "";
  if (!only.empty())
    builder.warn(fmt::format("no face names a material: all take '{}', the only one of the MTL",
                             clean_name(only, "?")));
  if (names_none && entries.size() > 1)
    builder.warn("no face names a material (usemtl): the default is used");
  std::erase_if(entries, [&](const Entry& entry) {
    return entry.name != only && !used.contains(entry.name);
  });
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
  if (!only.empty()) refs[""] = refs[only];
  for (const std::string& name : used) {
    if (name.empty() || refs.contains(name) || any_missing) continue;
    builder.warn(fmt::format("material '{}' is defined nowhere; the default is used",
                             clean_name(name, "?")));
  }
  return refs;
}

}  // namespace heliograph::assets
