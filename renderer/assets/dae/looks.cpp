// Shown geometries as meshes and materials of the library.
#include <algorithm>
#include <set>
#include <tuple>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/model.h"

namespace heliograph::assets::dae {
namespace {

/// The element of each part's material, null where the file binds none.
std::vector<Node> materials_of(const Document& document, const Shown& shown,
                               const std::vector<std::string>& symbols) {
  std::vector<Node> out;
  for (const std::string& symbol : symbols) {
    const auto bound = shown.material.find(symbol);
    out.push_back(bound == shown.material.end() ? document.find(symbol, "material")
                                                : bound->second);
  }
  return out;
}

/// The materials of all that is shown, each once, in the file's order of use.
std::vector<Node> used_materials(const Document& document, const std::vector<Shown>& all,
                                 Budget& budget) {
  std::vector<Node> used;
  std::set<Node> known;
  for (const Shown& shown : all) {
    std::vector<std::string> symbols;
    for (const Node& primitive : shown.geometry.child("mesh").children())
      if (const pugi::xml_attribute symbol = primitive.attribute("material"))
        symbols.emplace_back(symbol.value());
    budget.take(symbols.size(), sizeof(Ref), place(shown.geometry));  // of the entity
    for (const Node& material : materials_of(document, shown, symbols))
      if (material && known.insert(material).second) used.push_back(material);
  }
  return used;
}

/// A geometry, deformed by one skin and one morph, is one mesh wherever it is shown.
using Key = std::tuple<Node, Node, Node>;
using Geometries = std::map<Key, std::optional<Geometry>>;

Key key_of(const Shown& shown) { return {shown.geometry, shown.skin, shown.morph}; }

Geometries load_geometries(const Document& document, Builder& builder,
                           const std::vector<Shown>& all) {
  Geometries out;
  for (const Shown& shown : all) {
    if (out.contains(key_of(shown))) continue;
    std::shared_ptr<const Deformation> deformation;
    if (shown.skin || shown.morph)
      deformation = std::make_shared<const Deformation>(read_deformation(document, builder, shown));
    out.emplace(key_of(shown), load_geometry(document, builder, shown.geometry, deformation));
  }
  return out;
}

}  // namespace

std::vector<std::optional<Look>> load_looks(const Document& document, Builder& builder,
                                            const std::vector<Shown>& all) {
  std::vector<std::optional<Look>> looks;
  const Materials materials =
      load_materials(document, builder, used_materials(document, all, builder.budget));
  if (!builder.complete()) return looks;
  const Geometries geometries = load_geometries(document, builder, all);
  White white;
  for (const Shown& shown : all) {
    const std::optional<Geometry>& geometry = geometries.at(key_of(shown));
    looks.emplace_back();
    if (!geometry) continue;
    PutEntity put;
    put.mesh = geometry->mesh;
    std::vector<Ref> parts;
    bool bound = geometry->colored;
    for (const Node& material : materials_of(document, shown, geometry->symbols)) {
      parts.push_back(material ? materials.at(material) : Ref());
      bound |= bool(material);
    }
    if (geometry->colored) white.fill(parts, builder);
    if (bound) put.materials = std::move(parts);
    looks.back() = Look{std::move(put), *geometry};
  }
  if (std::ranges::none_of(looks, [](const auto& look) { return look.has_value(); }))
    refuse("scene", "the file shows no geometry");
  return looks;
}

}  // namespace heliograph::assets::dae
