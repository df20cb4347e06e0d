// Source: glTF 2.0, 3.7.2 (Meshes).
#include "renderer/assets/gltf/primitive.h"

#include <algorithm>
#include <numeric>

#include "renderer/assets/influences.h"

namespace heliograph::assets::gltf {
namespace {

/// Our textures have v = 0 at the bottom, glTF's at the top.
void flip_v(std::vector<vec2>& uvs) {
  for (vec2& uv : uvs) uv.y = 1 - uv.y;
}

std::vector<vec4> read_colors(const Document& document, const Value& accessor, Builder& builder) {
  std::vector<vec4> colors;
  if (accessor_components(document, accessor) == 4) {
    colors = read_as<vec4>(document, accessor, builder.budget);
  } else {
    for (const vec3& rgb : read_as<vec3>(document, accessor, builder.budget))
      colors.emplace_back(rgb, 1);
  }
  bool clamped = false;
  for (vec4& color : colors) {
    const vec4 inside = glm::clamp(color, 0.0f, 1.0f);
    clamped |= inside != color;
    color = inside;
  }
  if (clamped) builder.warn(fmt::format("{}: colours were clamped to [0, 1]", accessor.where()));
  return colors;
}

void read_influences(const Document& document, const Value& attributes, Builder& builder,
                     MeshData& mesh) {
  const std::size_t count = mesh.positions.size();
  std::vector<std::vector<u32>> joints;
  std::vector<std::vector<vec4>> weights;
  for (u32 set = 0; attributes.find(fmt::format("JOINTS_{}", set)); ++set) {
    const Value joint = attributes.at(fmt::format("JOINTS_{}", set));
    const Value weight = attributes.at(fmt::format("WEIGHTS_{}", set));
    joints.push_back(read_integers(document, joint, 4, builder.budget));
    weights.push_back(read_as<vec4>(document, weight, builder.budget));
    if (joints.back().size() != count * 4 || weights.back().size() != count) {
      refuse(joint.where(), "has another count than POSITION");
    }
    if (std::ranges::any_of(joints.back(), [](u32 index) { return index > 0xffff; })) {
      refuse(joint.where(), "a joint index exceeds 65535");
    }
  }
  if (joints.empty()) return;
  if (joints.size() > 1) {
    builder.warn("vertices follow more than 4 joints; the 4 strongest are kept");
  }
  builder.budget.take(count, sizeof(vec4) + sizeof(glm::u16vec4), attributes.where());
  std::vector<Influence> influences;
  for (std::size_t v = 0; v < count; ++v) {
    influences.clear();
    for (std::size_t set = 0; set < joints.size(); ++set) {
      for (int i = 0; i < 4; ++i) {
        influences.push_back({joints[set][v * 4 + std::size_t(i)], weights[set][v][i]});
      }
    }
    keep_strongest(influences, mesh);
  }
}

void read_targets(const Document& document, const Value& primitive, Budget& budget,
                  MeshData& mesh) {
  const auto targets = primitive.find("targets");
  if (!targets) return;
  const std::size_t count = mesh.positions.size();
  bool any_normals = false;
  for (std::size_t i = 0; i < targets->size(); ++i) {
    const Value target = (*targets)[i];
    const auto deltas = [&](const std::string& key) {
      const auto accessor = target.find(key);
      if (accessor) {
        std::vector<vec3> values = read_as<vec3>(document, *accessor, budget);
        if (values.size() != count) refuse(accessor->where(), "has another count than POSITION");
        return values;
      }
      budget.take(count, sizeof(vec3), target.where());
      return std::vector<vec3>(count, vec3(0));
    };
    mesh.morph_positions.push_back(deltas("POSITION"));
    mesh.morph_normals.push_back(deltas("NORMAL"));
    any_normals |= target.find("NORMAL").has_value();
  }
  if (!any_normals || mesh.normals.empty()) mesh.morph_normals.clear();
}

/// The vertices of a primitive in the order of its indices, each below `vertices`: one by one, or
/// in threes.
template <class T>
std::vector<T> read_order(const Document& document, const Value& primitive, u32 vertices,
                          Budget& budget) {
  std::vector<T> order;
  const auto words = [&] {
    return std::span(reinterpret_cast<u32*>(order.data()), order.size() * sizeof(T) / sizeof(u32));
  };
  if (const auto indices = primitive.find("indices")) {
    order = read_integers<T>(document, *indices, 1, budget);
    const auto beyond = std::ranges::find_if(words(), [&](u32 i) { return i >= vertices; });
    if (beyond != words().end()) {
      refuse(indices->where(), fmt::format("element {} is {}, but there are {} vertices",
                                           beyond - words().begin(), *beyond, vertices));
    }
  } else {
    budget.take(vertices, sizeof(u32), primitive.where());
    order.resize((vertices * sizeof(u32) + sizeof(T) - 1) / sizeof(T));
    std::iota(words().begin(), words().end(), 0u);
  }
  return order;
}

/// Triangles of a strip (mode 5) or a fan.
std::vector<uvec3> joined(const std::vector<u32>& order, bool is_strip, std::size_t count) {
  std::vector<uvec3> triangles;
  triangles.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t odd = i % 2;
    const uvec3 t = is_strip ? uvec3(order[i], order[i + 1 + odd], order[i + 2 - odd])
                             : uvec3(order[i + 1], order[i + 2], order[0]);
    const bool joins_strips = is_strip && (t.x == t.y || t.y == t.z || t.z == t.x);
    if (!joins_strips) triangles.push_back(t);
  }
  return triangles;
}

}  // namespace

std::vector<uvec3> read_triangles(const Document& document, const Value& primitive, u32 vertices,
                                  Builder& builder) {
  Budget& budget = builder.budget;
  const u64 mode = primitive.whole("mode", 4);
  const auto indices = primitive.find("indices");
  const bool is_list = mode == 4;
  std::vector<uvec3> triangles;
  std::vector<u32> order;
  if (is_list) {
    triangles = read_order<uvec3>(document, primitive, vertices, budget);
  } else {
    order = read_order<u32>(document, primitive, vertices, budget);
  }
  const u64 corners = indices ? accessor_count(document, *indices) : vertices;
  if (is_list && corners % 3 != 0) {
    if (corners < 3)
      refuse(primitive.where(), fmt::format("{} indices do not make triangles", corners));
    builder.warn(fmt::format("{}: the last {} of {} corners make no triangle and are left out",
                             primitive.where(), corners % 3, corners));
    triangles.resize(corners / 3);
  }
  const u64 count = is_list ? corners / 3 : std::max<u64>(corners, 2) - 2;
  Budget::check(count, budget.limits().triangles, "triangles", primitive.where());
  budget.take(count, sizeof(uvec3), primitive.where());  // of a strip, or where parts are joined
  if (!is_list) triangles = joined(order, mode == 5, count);
  return triangles;
}

MeshData read_vertices(const Document& document, const Value& primitive, Builder& builder) {
  Budget& budget = builder.budget;
  const Value attributes = primitive.at("attributes");
  const Value position = attributes.at("POSITION");
  Budget::check(accessor_count(document, position), budget.limits().vertices, "vertices",
                position.where());
  MeshData mesh;
  mesh.positions = read_as<vec3>(document, position, budget);
  const auto read = [&]<class T>(const std::string& key, std::vector<T>& out) {
    const auto accessor = attributes.find(key);
    if (!accessor) return;
    out = read_as<T>(document, *accessor, budget, NonFinite::kZeros);
    if (out.size() != mesh.positions.size()) {
      refuse(accessor->where(), fmt::format("has {} elements, but POSITION has {}", out.size(),
                                            mesh.positions.size()));
    }
  };
  read("NORMAL", mesh.normals);
  if (!mesh.normals.empty()) read("TANGENT", mesh.tangents);
  read("TEXCOORD_0", mesh.uvs);
  read("TEXCOORD_1", mesh.uvs1);
  flip_v(mesh.uvs);
  flip_v(mesh.uvs1);
  if (const auto color = attributes.find("COLOR_0")) {
    mesh.colors = read_colors(document, *color, builder);
    if (mesh.colors.size() != mesh.positions.size()) {
      refuse(color->where(), "has another count than POSITION");
    }
  }
  read_influences(document, attributes, builder, mesh);
  read_targets(document, primitive, budget, mesh);
  return mesh;
}

}  // namespace heliograph::assets::gltf
