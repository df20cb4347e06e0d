// COLLADA to an asset: the order of the steps. Chosen by load.cpp.
//
// The root entity is the user's. Below it each geometry that a node shows is an entity, whose pose
// holds the transforms of the nodes, the turn to +Z up and the scale to metres.
#include <algorithm>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/model.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

using namespace dae;

/// What <asset> says of axes and units, unless the caller says otherwise.
mat4x3 world_from_file(const Document& document, const Builder& builder) {
  const Node asset = document.root().child("asset");
  std::string up = builder.options.up;
  if (up.empty()) {
    const std::string_view axis = trimmed(asset.child_value("up_axis"));
    if (axis != "" && axis != "X_UP" && axis != "Y_UP" && axis != "Z_UP")
      refuse("asset.up_axis", "must be X_UP, Y_UP or Z_UP");
    up = std::string(1, axis == "Z_UP" ? 'z' : axis == "X_UP" ? 'x' : 'y');
  }
  double metres = builder.options.units;
  if (!(metres > 0)) {
    std::string meter(trimmed(asset.child("unit").attribute("meter").value()));
    std::ranges::replace(meter, ',', '.');  // of programs in some languages
    metres = meter.empty() ? 1 : double(parse_number(meter).value_or(0));
    constexpr double kSmallest = 1e-9, kLargest = 1e9;
    if (!(metres >= kSmallest && metres <= kLargest))
      refuse("asset.unit.meter", "must be a number of metres in [1e-9, 1e9]; give units=");
  }
  return mat4x3(mat4(float(metres) * z_up_from(up)));
}

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

mat4x3 about(const glm::dvec3& centre, mat4x3 pose) {
  pose[3] = vec3(glm::dmat4x3(pose) * glm::dvec4(centre, 1));
  return pose;
}

}  // namespace

void load_dae(Builder& builder) {
  const Document document(builder);
  const mat4x3 world = world_from_file(document, builder);
  const std::vector<Shown> all = read_scene(document, builder);
  const Materials materials =
      load_materials(document, builder, used_materials(document, all, builder.budget));
  if (!builder.complete()) return;
  std::map<Node, std::optional<Geometry>> geometries;
  for (const Shown& shown : all)
    if (!geometries.contains(shown.geometry))
      geometries.emplace(shown.geometry, load_geometry(document, builder, shown.geometry));
  White white;
  std::vector<std::pair<std::string_view, PutEntity>> puts;
  for (const Shown& shown : all) {
    const std::optional<Geometry>& geometry = geometries.at(shown.geometry);
    if (!geometry) continue;
    PutEntity put;
    put.mesh = geometry->mesh;
    const mat4x3 pose = about(geometry->centre, affine_product(world, shown.pose));
    if (pose != mat4x3(1)) put.pose = constant_pose(pose);
    std::vector<Ref> parts;
    bool bound = geometry->colored;
    for (const Node& material : materials_of(document, shown, geometry->symbols)) {
      parts.push_back(material ? materials.at(material) : Ref());
      bound |= bool(material);
    }
    if (geometry->colored) white.fill(parts, builder);
    if (bound) put.materials = std::move(parts);
    puts.emplace_back(shown.name, std::move(put));
  }
  if (puts.empty()) refuse("scene", "the file shows no geometry");
  const u32 root = builder.entity("", PutEntity{});
  for (auto& [name, put] : puts) {
    put.parent = builder.entity_ref(root);
    builder.entity(builder.claim_name(name, "node"), std::move(put));
  }
}

}  // namespace heliograph::assets
