// A transaction as text, one line an edit: equal texts mean equal edits. Arrays are named by their
// serial numbers, so only the very same bytes are equal. For tests that compare scenes.
#pragma once

#include <fmt/format.h>

#include "renderer/scene/scene.h"

namespace heliograph::dump {

inline std::string text(float v) { return fmt::format("{}", v); }
inline std::string text(const vec3& v) { return fmt::format("({} {} {})", v.x, v.y, v.z); }
template <int C, int R>
std::string text(const glm::mat<C, R, float>& m) {
  std::string out = "[";
  for (int c = 0; c < C; ++c)
    for (int r = 0; r < R; ++r) out += fmt::format("{} ", m[c][r]);
  return out + "]";
}
inline std::string text(const Ref& ref) {
  if (const auto* id = std::get_if<Id>(&ref)) return fmt::format("#{}", id->value);
  if (const auto* name = std::get_if<std::string>(&ref)) return *name;
  if (const auto* edit = std::get_if<CreatedByEdit>(&ref)) return fmt::format("@{}", edit->edit);
  return "-";
}
template <class T, class F>
std::string list(const T& values, F&& f) {
  std::string out = "{";
  for (const auto& value : values) out += f(value) + " ";
  return out + "}";
}
inline std::string text(const TextureUsePatch& p) {
  return fmt::format("use({} {} {} {} {} {})", text(p.texture), p.use.uv_set, p.use.channel,
                     p.use.scale, p.use.offset, text(p.use.uv_transform));
}
inline std::string text(const PosePatch& p) {
  return list(p.times, [](Time t) { return fmt::format("{}", t); }) +
         list(p.matrices, [](const mat4x3& m) { return text(m); });
}
inline std::string text(const LightPatch& p) {
  const Light& l = p.light;
  return fmt::format("light({} {} {} {} {} {} {})", text(l.color), l.intensity, int(l.unit),
                     l.exposure, l.temperature, l.two_sided, text(p.texture));
}
inline std::string text(const LabelPatch& p) {
  return fmt::format("label({} {} {} {} {})", int(p.kind), p.value, p.group,
                     p.category.value_or("-"), p.part);
}
inline std::string text(const PutEntity& p) {
  std::string out = "entity";
  if (p.parent) out += " parent=" + text(*p.parent);
  if (p.pose) out += " pose=" + text(*p.pose);
  if (p.mesh) out += " mesh=" + text(*p.mesh);
  if (p.materials) out += list(*p.materials, [](const Ref& r) { return text(r); });
  if (p.light && *p.light) out += text(**p.light);
  if (p.camera && *p.camera)
    out += fmt::format(" camera={} {}", (*p.camera)->width, (*p.camera)->fx);
  if (p.volume) out += " volume=" + text(*p.volume);
  if (p.skin && *p.skin) {
    out += " skin" + list((*p.skin)->joints, [](const Ref& r) { return text(r); });
    out += list((*p.skin)->inverse_binds, [](const mat4x3& m) { return text(m); });
  }
  if (p.morph_weights && *p.morph_weights)
    out += " morphs" + list((*p.morph_weights)->weights, [](float w) { return text(w); });
  if (p.label) out += " " + text(*p.label);
  if (p.visible) out += fmt::format(" visible={}", *p.visible);
  if (p.visibility) out += fmt::format(" rays={}", *p.visibility);
  if (p.shadow_catcher) out += fmt::format(" catcher={}", *p.shadow_catcher);
  if (p.light_group) out += " light_group=" + *p.light_group;
  if (p.is_static) out += fmt::format(" static={}", *p.is_static);
  if (p.teleport) out += " teleport";
  if (p.attributes)
    out += list(*p.attributes, [](const auto& a) { return a.first + ":" + a.second; });
  return out;
}
inline std::string text(const PutMesh& p) {
  return fmt::format("mesh {} {} {}", p.topology ? p.topology->triangles.serial() : 0,
                     p.vertices->positions.serial(), p.vertices->normals.serial());
}
inline std::string text(const PutMaterial& p) {
  std::string out = "material";
  for (const ParameterPatch& parameter : p.parameters) {
    out += parameter.value ? text(*parameter.value) : "-";
    if (parameter.texture) out += text(*parameter.texture);
  }
#define HELIO_MAP(name) \
  if (p.name) out += " " #name "=" + text(*p.name);
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  return out + fmt::format(" {} {} {} {} {} {}", int(p.alpha_mode.value_or(AlphaMode::kOpaque)),
                           p.alpha_cutoff.value_or(-1), p.two_sided_emission.value_or(false),
                           p.unlit.value_or(false), p.thin_walled.value_or(false),
                           p.priority.value_or(0));
}
inline std::string text(const PutTexture& p) {
  return fmt::format("texture {} {} {} {} {}", p.image->texels->serial(), p.srgb.value_or(false),
                     p.nearest.value_or(false), int(p.wrap_u.value_or(Wrap::kRepeat)),
                     int(p.wrap_v.value_or(Wrap::kRepeat)));
}
inline std::string text(const PutVolume& p) {
  const auto grid = [](const std::shared_ptr<const Grid>& g) { return g ? g->values.serial() : 0; };
  return fmt::format("volume {} {} {} {} {} {} {} {}", grid(p.density),
                     grid(p.temperature.value_or(nullptr)), grid(p.color.value_or(nullptr)),
                     p.density_scale.value_or(-1), text(p.albedo.value_or(vec3(-1))),
                     p.anisotropy.value_or(-1), p.temperature_scale.value_or(-1),
                     p.emission_scale.value_or(-1));
}
inline std::string text(const PutSettings& p) {
  std::string out = fmt::format("settings {}", p.time.value_or(-1)) +
                    list(p.categories, [](const std::string& c) { return c; });
  if (!p.dome) return out;
  const PutDome& d = *p.dome;
  out += fmt::format(" dome {} {} {} {} {}", text(*d.texture), *d.intensity,
                     text(*d.world_from_dome), *d.camera_visible, *d.light_group);
  return out + (*d.color ? text(**d.color) : "");
}
inline std::string text(const Remove& a) { return a.cascade ? "remove all" : "remove"; }
template <class T>
std::string text(const T&) {
  return "an action that describe() does not use";
}

inline std::string text(const Transaction& transaction) {
  std::string out;
  for (const Edit& edit : transaction.edits)
    out += fmt::format("{} {} {}\n", int(edit.mode), text(edit.target),
                       std::visit([](const auto& action) { return text(action); }, edit.action));
  return out;
}
inline std::string text(const SceneDescription& description) {
  std::string out = text(description.scene) + "before:\n" + text(description.previous);
  for (const auto& kept : description.libraries)
    out += "library " + kept.asset +
           list(kept.edits, [](auto e) { return e ? fmt::format("@{}", *e) : "gone"; }) + "\n";
  return out;
}
inline std::string text(const Snapshot& snapshot) { return text(describe(snapshot)); }

}  // namespace heliograph::dump
