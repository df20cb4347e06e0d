// Source: glTF 2.0, 3.5.2 and 3.5.3 (node hierarchy, transformations).
#include <algorithm>
#include <glm/gtc/matrix_access.hpp>

#include "renderer/assets/gltf/nodes.h"
#include "renderer/assets/poses.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets::gltf {
namespace {

void read_matrix(const Value& value, Node& node) {
  constexpr float kRounding = 1e-5f;
  const auto matrix = value.numbers("matrix", mat4(1));
  const vec4 off = glm::row(matrix, 3) - vec4(0, 0, 0, 1);
  if (glm::any(glm::greaterThan(glm::abs(off), vec4(kRounding))))
    refuse(value.key_where("matrix"), "the last row must be 0 0 0 1");
  node.has_matrix = true;
  node.local = mat4x3(matrix);
}

void read_trs(const Value& value, Node& node, Builder& builder) {
  node.translation = value.numbers("translation", vec3(0));
  const auto r = value.numbers("rotation", vec4(0, 0, 0, 1));
  node.rotation = unit_rotation(quat(r.w, r.x, r.y, r.z), value.key_where("rotation"), builder);
  node.scale = value.numbers("scale", vec3(1));
  node.local = compose_trs(node.translation, node.rotation, node.scale);
}

/// Fills parents and children; refuses a second parent, and cycles, which no root reaches.
void link(std::vector<Node>& nodes) {
  for (u32 i = 0; i < nodes.size(); ++i) {
    const auto children = nodes[i].value.find("children");
    if (!children) continue;
    for (const Value& value : children->elements()) {
      const u32 child = value.index(nodes.size());
      if (nodes[child].parent) refuse(value.where(), fmt::format("node {} has two parents", child));
      nodes[child].parent = i;
      nodes[i].children.push_back(child);
    }
  }
  std::vector<u32> reached;
  for (u32 i = 0; i < nodes.size(); ++i) {
    if (!nodes[i].parent) reached.push_back(i);
  }
  std::vector<bool> seen(nodes.size());
  for (std::size_t k = 0; k < reached.size(); ++k) {
    seen[reached[k]] = true;
    const auto& children = nodes[reached[k]].children;
    reached.insert(reached.end(), children.begin(), children.end());
  }
  const auto lost = std::ranges::find(seen, false);
  if (lost != seen.end()) {
    refuse(fmt::format("nodes[{}].children", lost - seen.begin()), "the nodes form a cycle");
  }
}

}  // namespace

std::vector<Node> read_nodes(const Document& document, Builder& builder) {
  std::vector<Node> nodes;
  Budget::check(document.count("nodes"), builder.options.limits.entities, "entities", "nodes");
  for (u32 i = 0; i < document.count("nodes"); ++i) {
    const Value value = document.item("nodes", i);
    Node node{.value = value, .name = {}, .parent = {}, .children = {}};
    if (value.find("matrix")) {
      read_matrix(value, node);
    } else {
      read_trs(value, node, builder);
    }
    node.local = thickened(node.local);
    node.name = builder.claim_name(value.text("name", ""), fmt::format("node_{}", i));
    nodes.push_back(std::move(node));
  }
  link(nodes);
  return nodes;
}

SkinData read_skin(const Document& document, const Value& skin, std::size_t nodes, Budget& budget) {
  SkinData data;
  const Value joints = skin.at("joints");
  if (joints.size() == 0 || joints.size() > 0x10000) {
    refuse(joints.where(), "must name 1 to 65536 joints");
  }
  for (const Value& joint : joints.elements()) data.joints.push_back(joint.index(nodes));
  data.inverse_binds.assign(data.joints.size(), mat4x3(1));
  if (const auto accessor = skin.find("inverseBindMatrices")) {
    const std::vector<mat4> matrices = read_as<mat4>(document, *accessor, budget);
    if (matrices.size() < data.joints.size()) {
      refuse(accessor->where(),
             fmt::format("has {} matrices for {} joints", matrices.size(), data.joints.size()));
    }
    for (std::size_t i = 0; i < data.joints.size(); ++i)
      data.inverse_binds[i] = mat4x3(matrices[i]);
  }
  return data;
}

}  // namespace heliograph::assets::gltf
