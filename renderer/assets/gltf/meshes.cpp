#include "renderer/assets/gltf/meshes.h"

#include <algorithm>
#include <map>
#include <utility>

#include "renderer/assets/gltf/primitive.h"
#include "renderer/assets/gltf/shading.h"
#include "renderer/assets/gltf/variants.h"
#include "renderer/assets/mikktspace.h"

namespace heliograph::assets::gltf {
namespace {

bool is_surface(const Value& primitive) {
  const u64 mode = primitive.whole("mode", 4);
  if (mode > 6) refuse(primitive.key_where("mode"), "must be 0 to 6");
  return mode >= 4 && primitive.at("attributes").find("POSITION");
}

/// Vertices that one or more primitives share, and where they begin in the mesh.
struct Piece {
  MeshData vertices;
  u32 first = 0;
};
struct Part {
  std::size_t piece = 0;
  std::vector<uvec3> triangles;
};

template <class T>
void append(std::vector<T>& all, std::vector<T>& some, std::size_t count, const T& fill) {
  if (some.empty()) some.assign(count, fill);
  all.insert(all.end(), some.begin(), some.end());
}

bool has_morph_normals(const Piece& piece) { return !piece.vertices.morph_normals.empty(); }

MeshData merge(std::vector<Piece>& pieces) {
  if (pieces.size() == 1) return std::move(pieces.front().vertices);
  MeshData all;
  // The merged mesh has those optional arrays that any piece has.
  const auto join = [&]<class T>(std::vector<T> MeshData::* array, const T& fill) {
    const auto has = [&](const Piece& piece) { return !(piece.vertices.*array).empty(); };
    if (std::ranges::none_of(pieces, has)) return;
    for (auto& [mesh, first] : pieces) append(all.*array, mesh.*array, mesh.positions.size(), fill);
  };
  join(&MeshData::normals, vec3(0, 0, 1));
  join(&MeshData::uvs, vec2(0));
  join(&MeshData::uvs1, vec2(0));
  join(&MeshData::colors, vec4(1));
  join(&MeshData::tangents, vec4(0, 0, 0, 1));
  join(&MeshData::joints, glm::u16vec4(0));
  join(&MeshData::weights, vec4(1, 0, 0, 0));
  all.morph_positions.resize(pieces.front().vertices.morph_positions.size());
  if (std::ranges::any_of(pieces, has_morph_normals))
    all.morph_normals.resize(all.morph_positions.size());
  for (auto& [mesh, first] : pieces) {
    const std::size_t count = mesh.positions.size();
    first = u32(all.positions.size());
    append(all.positions, mesh.positions, count, vec3(0));
    mesh.morph_normals.resize(all.morph_normals.size());
    for (std::size_t t = 0; t < all.morph_positions.size(); ++t)
      append(all.morph_positions[t], mesh.morph_positions[t], count, vec3(0));
    for (std::size_t t = 0; t < all.morph_normals.size(); ++t)
      append(all.morph_normals[t], mesh.morph_normals[t], count, vec3(0));
  }
  return all;
}

class Loader {
 public:
  Loader(const Document& document, Builder& builder, const Materials& materials)
      : document_(document), builder_(builder), materials_(materials) {}

  Mesh load(const Value& value, u32 index) {
    std::vector<Value> surfaces;
    for (const Value& primitive : value.at("primitives").elements()) {
      if (is_surface(primitive))
        surfaces.push_back(primitive);
      else
        builder_.warn("primitives of points or lines, or without POSITION, are left out");
    }
    Mesh mesh;
    if (surfaces.empty()) return mesh;
    read_parts(surfaces);
    MeshData data = merge(pieces_);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      add_part(surfaces[i], parts_[i], data, mesh);
    }
    for (const glm::u16vec4& joints : data.joints) {
      for (int i = 0; i < 4; ++i)
        mesh.joint_count = std::max<u32>(mesh.joint_count, joints[i] + 1u);
    }
    mesh.morph_count = u32(data.morph_positions.size());
    if (mesh.morph_count > 0) mesh.morph_weights = read_weights(value, mesh.morph_count);
    if (data.triangles.empty()) return mesh;
    mend_tangents(data);
    auto [put, mended] = finish_mesh(std::move(data), value.where(), builder_.budget);
    if (mended > 0) {
      builder_.warn(fmt::format("{}: {} normals without a direction became those of their faces",
                                value.where(), mended));
    }
    mesh.topology = put.topology;
    mesh.vertices = put.vertices;
    mesh.ref = builder_.library(
        builder_.claim_name(value.text("name", ""), fmt::format("mesh_{}", index)), std::move(put));
    return mesh;
  }

 private:
  void read_parts(const std::vector<Value>& surfaces) {
    const auto has_normals = [](const Value& primitive) {
      return primitive.at("attributes").find("NORMAL").has_value();
    };
    const bool any_normals = std::ranges::any_of(surfaces, has_normals);
    std::map<std::string, std::size_t> known;
    u64 vertices = 0;
    for (const Value& primitive : surfaces) {
      const auto targets = primitive.find("targets");
      const std::string key = primitive.at("attributes").dump() + (targets ? targets->dump() : "");
      auto [at, is_new] = known.try_emplace(key, pieces_.size());
      if (is_new) pieces_.push_back({.vertices = read_vertices(document_, primitive, builder_)});
      Part part{.piece = at->second, .triangles = {}};
      const MeshData& shared = pieces_[part.piece].vertices;
      part.triangles = read_triangles(document_, primitive, u32(shared.positions.size()), builder_);
      // Beside parts with normals, a part without takes its triangles' own.
      if (any_normals && !has_normals(primitive)) unshare(part, flat_shaded);
      const auto& first = pieces_.front().vertices.morph_positions;
      if (pieces_[part.piece].vertices.morph_positions.size() != first.size()) {
        refuse(primitive.where(), "has another number of morph targets than the first primitive");
      }
      vertices += is_new ? pieces_.back().vertices.positions.size() : 0;
      Budget::check(vertices, builder_.options.limits.vertices, "vertices", primitive.where());
      parts_.push_back(std::move(part));
    }
    drop_unused();
    make_tangents(surfaces);
  }

  /// Empties what parts shared before they got vertices of their own.
  void drop_unused() {
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (std::ranges::count(parts_, i, &Part::piece) > 0) continue;
      const std::size_t targets = pieces_[i].vertices.morph_positions.size();
      pieces_[i].vertices = {};
      pieces_[i].vertices.morph_positions.resize(targets);
    }
  }

  /// Makes tangents where a material asks for them. Meshes that joints or morph targets deform keep
  /// those of their triangles, which follow. Beside parts with tangents all parts have them.
  void make_tangents(const std::vector<Value>& surfaces) {
    const auto has_tangents = [](const Piece& piece) { return !piece.vertices.tangents.empty(); };
    bool any = std::ranges::any_of(pieces_, has_tangents);
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const MeshData& vertices = pieces_[parts_[i].piece].vertices;
      const bool deforms = !vertices.joints.empty() || !vertices.morph_positions.empty();
      any |= !deforms && lacks_tangents(vertices) && wants_tangents(surfaces[i]);
    }
    if (!any) return;
    for (std::size_t i = 0; i < pieces_.size(); ++i)
      if (lacks_tangents(pieces_[i].vertices)) add_tangents_to(i);
  }

  static bool lacks_tangents(const MeshData& vertices) {
    return vertices.tangents.empty() && !vertices.normals.empty() && !vertices.uvs.empty();
  }

  [[nodiscard]] bool wants_tangents(const Value& primitive) const {
    const std::size_t count = materials_.wants_tangents.size();
    return std::ranges::any_of(materials_of(primitive), [&](const Value& material) {
      return materials_.wants_tangents[material.index(count)];
    });
  }

  /// Adds tangents to vertices; parts that share them are one surface.
  void add_tangents_to(std::size_t piece) {
    MeshData& mesh = pieces_[piece].vertices;
    for (const Part& part : parts_) {
      if (part.piece == piece)
        mesh.triangles.insert(mesh.triangles.end(), part.triangles.begin(), part.triangles.end());
    }
    add_tangents(mesh, builder_.budget);
    const std::vector<uvec3> split = std::exchange(mesh.triangles, {});
    auto next = split.begin();
    for (Part& part : parts_) {
      if (part.piece != piece) continue;
      std::copy_n(next, part.triangles.size(), part.triangles.begin());
      next += std::ptrdiff_t(part.triangles.size());
    }
  }

  /// Gives a part vertices of its own, as `shaded` makes them of its triangles.
  template <class Shaded>
  void unshare(Part& part, const Shaded& shaded) {
    pieces_.push_back(
        {.vertices = shaded(pieces_[part.piece].vertices, part.triangles, builder_.budget)});
    part.piece = pieces_.size() - 1;
    for (std::size_t i = 0; i < part.triangles.size(); ++i) {
      part.triangles[i] = uvec3(3 * i, 3 * i + 1, 3 * i + 2);
    }
  }

  void add_part(const Value& primitive, Part& part, MeshData& data, Mesh& mesh) {
    const u32 first = pieces_[part.piece].first;
    if (parts_.size() == 1) {
      data.triangles = std::move(part.triangles);
    } else {
      for (const uvec3& t : part.triangles) data.triangles.push_back(t + first);
      data.parts.insert(data.parts.end(), part.triangles.size(), u32(mesh.materials.size()));
    }
    const auto material = material_of(primitive, materials_.variant);
    std::string name = fmt::format("part_{}", mesh.materials.size());
    if (material) {
      const u32 index = material->index(document_.count("materials"));
      mesh.materials.push_back(materials_.refs[index]);
      name = clean_name(document_.item("materials", index).text("name", ""), name);
    } else {
      mesh.materials.push_back(materials_.fallback);
    }
    data.part_names.push_back(name);
  }

  const Document& document_;
  Builder& builder_;
  const Materials& materials_;
  std::vector<Piece> pieces_;
  std::vector<Part> parts_;
};

}  // namespace

std::vector<Mesh> load_meshes(const Document& document, Builder& builder,
                              const Materials& materials) {
  std::vector<Mesh> meshes;
  for (const Value& mesh : document.items("meshes"))
    meshes.push_back(Loader(document, builder, materials).load(mesh, u32(meshes.size())));
  return meshes;
}

std::vector<float> read_weights(const Value& owner, u32 targets) {
  std::vector<float> weights;
  const auto array = owner.find("weights");
  if (!array) return weights;
  if (array->size() != targets)
    refuse(array->where(), fmt::format("must have {} numbers", targets));
  for (const Value& weight : array->elements()) weights.push_back(weight.single());
  return weights;
}

bool any_without_material(const Document& document, std::optional<u32> variant) {
  for (const Value& mesh : document.items("meshes"))
    for (const Value& primitive : mesh.at("primitives").elements())
      if (!material_of(primitive, variant)) return true;
  return false;
}

}  // namespace heliograph::assets::gltf
