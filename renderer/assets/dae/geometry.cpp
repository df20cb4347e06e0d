// <geometry> to a mesh: its primitives are the parts. Source: COLLADA 1.5.0, chapter 5.
#include <algorithm>
#include <array>
#include <map>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/model.h"
#include "renderer/assets/polygon.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

/// Target of an <input>: rows of numbers.
struct Source {
  const std::vector<double>* numbers = nullptr;
  u32 count = 0, stride = 1, offset = 0, width = 0;

  [[nodiscard]] double exact(u32 row, u32 column) const {
    return column < width ? (*numbers)[offset + u64(row) * stride + column] : 1;
  }
  [[nodiscard]] glm::dvec3 position(u32 row) const {
    return {exact(row, 0), exact(row, 1), exact(row, 2)};
  }
  /// 0 for what is not finite, which only a place may not be.
  [[nodiscard]] float at(u32 row, u32 column) const {
    const double number = exact(row, column);
    return std::isfinite(number) ? float(number) : 0;
  }
  [[nodiscard]] vec3 three(u32 row) const { return {at(row, 0), at(row, 1), at(row, 2)}; }
};

enum Attribute : u8 { kPosition, kNormal, kUv, kColor, kAttributes };
constexpr std::array<u32, kAttributes> kWidth = {3, 3, 2, 3};  // the least that is needed

/// An attribute of a primitive's corners.
struct Input {
  Source source;
  u32 offset = kNone;  // in the corner's indices; kNone: absent
};
using Inputs = std::array<Input, kAttributes>;

/// Row of each source, kNone where there is none, and the primitive they are of.
struct Corner {
  u32 primitive = 0;
  std::array<u32, kAttributes> rows{kNone, kNone, kNone, kNone};
  bool operator==(const Corner&) const = default;
};

std::optional<Attribute> attribute_of(std::string_view semantic) {
  if (semantic == "POSITION") return kPosition;
  if (semantic == "NORMAL") return kNormal;
  if (semantic == "TEXCOORD") return kUv;
  if (semantic == "COLOR") return kColor;
  return std::nullopt;
}

class Reader {
 public:
  Reader(const Document& document, Builder& builder, const Node& geometry,
         std::shared_ptr<const Deformation> deformation)
      : document_(document), builder_(builder), geometry_(geometry), where_(place(geometry)) {
    out_.deformation = std::move(deformation);
  }

  std::optional<Geometry> read() {
    const Node mesh = geometry_.child("mesh");
    if (!mesh) {
      builder_.warn(fmt::format("{} is no <mesh> and is left out", where_));
      return std::nullopt;
    }
    has_normals_ = !!mesh.find_node([](const Node& node) {
      return std::string_view(node.attribute("semantic").value()) == "NORMAL";
    });
    for (const Node& node : mesh.children()) primitive(node);
    if (mesh_.triangles.empty()) {
      builder_.warn(fmt::format("{} has no faces and is left out", where_));
      return std::nullopt;
    }
    if (!any_[kUv]) mesh_.uvs.clear();
    finish_colors();
    if (!any_[kNormal]) mesh_.normals.clear();
    Centred placed = centred(positions_, builder_);
    mesh_.positions = std::move(placed.positions);
    out_.centre = placed.centre;
    if (out_.deformation) deform(mesh_, *out_.deformation, rows_, builder_.budget);
    for (std::size_t i = 0; i < out_.symbols.size(); ++i)
      mesh_.part_names.push_back(clean_name(out_.symbols[i], fmt::format("part_{}", i)));
    const std::string name = builder_.claim_name(name_of(geometry_), "mesh");
    out_.mesh = builder_.library(name, finish_mesh(std::move(mesh_), where_, builder_.budget).put);
    return std::move(out_);
  }

 private:
  void primitive(const Node& node) {
    const std::string_view kind = node.name();
    if (kind == "lines" || kind == "linestrips") return builder_.warn("lines are left out");
    const bool strip = kind == "tristrips";
    const bool fan = kind == "trifans";
    if (kind != "triangles" && kind != "polylist" && kind != "polygons" && !strip && !fan) return;
    if (node.child("ph")) refuse_unimplemented(where_, "polygons with holes; triangulate the file");
    begin(node);
    if (kind == "polylist") return polylist(node);
    for (const Node& p : node.children("p")) {
      const std::vector<u32> indices = indices_of(p);
      if (kind == "polygons") {
        polygon(indices);
      } else if (kind == "triangles") {
        if (indices.size() % (3 * stride_) != 0) refuse(where_, "<p> has no whole triangles");
        for (std::size_t i = 0; i < indices.size(); i += 3 * stride_)
          polygon(std::span(indices).subspan(i, 3 * stride_));
      } else {
        band(indices, strip);
      }
    }
  }

  void polylist(const Node& node) {
    const std::vector<u32> counts = read_indices(node.child("vcount"), builder_.budget);
    const std::vector<u32> indices = indices_of(node.child("p"));
    u64 at = 0;
    for (const u32 count : counts) {
      const u64 size = u64(count) * stride_;
      if (size > indices.size() - at) refuse(where_, "<vcount> counts more corners than <p> has");
      polygon(std::span(indices).subspan(at, size));
      at += size;
    }
    if (at != indices.size()) refuse(where_, "<vcount> counts fewer corners than <p> has");
  }

  /// A strip or a fan: every further corner makes a triangle.
  void band(const std::vector<u32>& indices, bool strip) {
    const std::size_t corners = indices.size() / stride_;
    const auto corner = [&](std::size_t i) {
      return std::span(indices).subspan(i * stride_, stride_);
    };
    std::vector<u32> triangle;
    for (std::size_t i = 2; i < corners; ++i) {
      const std::size_t first = strip ? i - 2 + (i & 1) : 0;
      const std::size_t second = strip ? i - 1 - (i & 1) : i - 1;
      triangle.clear();
      for (const std::size_t k : {first, second, i})
        triangle.insert(triangle.end(), corner(k).begin(), corner(k).end());
      polygon(triangle);
    }
  }

  std::vector<u32> indices_of(const Node& p) {
    std::vector<u32> indices = read_indices(p, builder_.budget);
    if (indices.size() % stride_ != 0)
      refuse(where_, fmt::format("<p> has {} indices, {} a corner", indices.size(), stride_));
    return indices;
  }

  // ---------------------------------------------------------------- inputs

  /// The inputs of a primitive and its part.
  void begin(const Node& node) {
    inputs_ = {};
    stride_ = 1;
    ++primitive_;
    u32 uv_set = kNone;
    for (const Node& input : node.children("input")) {
      const u32 offset = offset_of(input);
      stride_ = std::max(stride_, offset + 1);
      const std::string_view semantic = input.attribute("semantic").value();
      if (semantic == "VERTEX") {
        const Node vertices =
            document_.linked(input.attribute("source").value(), "vertices", where_);
        for (const Node& own : vertices.children("input")) use(own, offset);
      } else if (semantic == "TEXCOORD") {
        const u32 set = whole_attribute(input, "set", 0);
        if (uv_set == kNone || set < uv_set) use(input, offset), uv_set = set;
      } else {
        use(input, offset);
      }
    }
    if (inputs_[kPosition].offset == kNone) refuse(where_, "a primitive has no POSITION");
    const std::string symbol = node.attribute("material").value();
    const auto [known, is_new] = parts_.try_emplace(symbol, u32(out_.symbols.size()));
    part_ = known->second;
    if (is_new) out_.symbols.push_back(symbol);
  }

  void use(const Node& input, u32 offset) {
    const auto attribute = attribute_of(input.attribute("semantic").value());
    if (!attribute) return;
    inputs_[*attribute] = {source(input.attribute("source").value(), kWidth[*attribute]), offset};
  }

  Source source(std::string_view url, u32 needed) {
    const Node node = document_.linked(url, "source", where_);
    const Node accessor = node.child("technique_common").child("accessor");
    const Node array =
        document_.linked(accessor.attribute("source").value(), "float_array", where_);
    auto known = arrays_.find(array);
    if (known == arrays_.end())
      known = arrays_.emplace(array, read_doubles(array, builder_.budget)).first;
    Source out{.numbers = &known->second,
               .count = whole_attribute(accessor, "count", 0),
               .stride = whole_attribute(accessor, "stride", 1),
               .offset = whole_attribute(accessor, "offset", 0)};
    const auto params = accessor.children("param");
    out.width = u32(std::distance(params.begin(), params.end()));
    const u64 end = out.count == 0 ? 0 : out.offset + u64(out.count - 1) * out.stride + out.width;
    if (out.width < needed || out.width > out.stride || end > known->second.size())
      refuse(place(node), fmt::format("its accessor takes {} rows of {} of {} numbers", out.count,
                                      out.width, known->second.size()));
    return out;
  }

  // ---------------------------------------------------------------- faces

  void polygon(std::span<const u32> indices) {
    const std::size_t count = indices.size() / stride_;
    if (count < 3) return builder_.warn("faces of fewer than 3 corners are left out");
    corners_.assign(count, {});
    polygon_.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      corners_[i] = corner(indices.subspan(i * stride_, stride_));
      polygon_[i] = inputs_[kPosition].source.position(corners_[i].rows[kPosition]);
    }
    const bool bare = inputs_[kNormal].offset == kNone;
    const bool flat = bare && has_normals_;
    any_[kNormal] |= !bare;
    if (flat) flat_normal_ = normal_of(polygon_);
    triangulate(polygon_, local_);
    Budget::check(mesh_.triangles.size() + local_.size(), builder_.options.limits.triangles,
                  "triangles", where_);
    made_.assign(count, kNone);
    for (const uvec3& t : local_) {
      for (const u32 i : {t.x, t.y, t.z})
        if (made_[i] == kNone) made_[i] = vertex(corners_[i], flat);
      mesh_.triangles.emplace_back(made_[t.x], made_[t.y], made_[t.z]);
      mesh_.parts.push_back(part_);
    }
  }

  Corner corner(std::span<const u32> indices) const {
    Corner out{.primitive = primitive_};
    for (u32 a = 0; a < kAttributes; ++a) {
      if (inputs_[a].offset == kNone) continue;
      const u32 row = indices[inputs_[a].offset];
      if (row >= inputs_[a].source.count)
        refuse(where_, fmt::format("index {} is not below {}", row, inputs_[a].source.count));
      out.rows[a] = row;
    }
    return out;
  }

  /// Corners of one primitive that are equal share a vertex, but where normals are the face's own.
  u32 vertex(const Corner& c, bool flat) {
    if (!flat) {
      const auto known = vertices_.find(c);
      if (known != vertices_.end()) return known->second;
    }
    const auto index = u32(positions_.size());
    Budget::check(u64(index) + 1, builder_.options.limits.vertices, "vertices", where_);
    const auto three = [&](Attribute a, vec3 absent) {
      return c.rows[a] == kNone ? absent : inputs_[a].source.three(c.rows[a]);
    };
    positions_.push_back(inputs_[kPosition].source.position(c.rows[kPosition]));
    if (out_.deformation) rows_.push_back({c.rows[kPosition], c.rows[kNormal]});
    mesh_.normals.push_back(three(kNormal, flat_normal_));
    mesh_.uvs.emplace_back(vec2(three(kUv, vec3(0))));
    const u32 color = c.rows[kColor];
    const vec3 rgb = three(kColor, vec3(1));
    mesh_.colors.emplace_back(rgb, color == kNone ? 1 : inputs_[kColor].source.at(color, 3));
    any_[kUv] |= c.rows[kUv] != kNone;
    any_[kColor] |= color != kNone;
    if (!flat) vertices_.emplace(c, index);
    return index;
  }

  /// They are sRGB.
  void finish_colors() {
    out_.colored = any_[kColor];
    if (!any_[kColor]) return mesh_.colors.clear();
    clamp_colors(mesh_.colors, builder_);
    make_linear(mesh_.colors);
  }

  const Document& document_;
  Builder& builder_;
  const Node geometry_;
  const std::string where_;
  Geometry out_;
  MeshData mesh_;
  std::map<std::string, u32> parts_;  // by symbol
  std::map<Node, std::vector<double>> arrays_;
  Inputs inputs_;
  u32 stride_ = 1, part_ = 0, primitive_ = 0;
  std::unordered_map<Corner, u32, VertexHash> vertices_;
  std::vector<Corner> corners_;
  std::vector<glm::dvec3> polygon_, positions_;
  std::vector<uvec3> local_;
  std::vector<u32> made_;   // vertex of each corner of a face
  std::vector<Rows> rows_;  // of vertices, where a skin or a morph needs them
  vec3 flat_normal_{0, 0, 1};
  bool has_normals_ = false;
  std::array<bool, kAttributes> any_{};
};

}  // namespace

std::optional<Geometry> load_geometry(const Document& document, Builder& builder,
                                      const Node& geometry,
                                      std::shared_ptr<const Deformation> deformation) {
  return Reader(document, builder, geometry, std::move(deformation)).read();
}

}  // namespace heliograph::assets::dae
