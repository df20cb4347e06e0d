// OBJ: one mesh, whose parts are its (group, material) pairs. Chosen by load.cpp.
// Source: Wavefront, Object Files, appendix B1.
#include <algorithm>
#include <map>
#include <unordered_map>

#include "renderer/assets/model.h"
#include "renderer/assets/mtl.h"
#include "renderer/assets/polygon.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

constexpr u32 kNone = ~0u;
constexpr u32 kFlat = 1u << 31;  // marks an index into the normals of faces

/// A corner of a face: 0-based indices, kNone where the file gives none.
struct Corner {
  u32 position = 0, uv = kNone, normal = kNone;
  bool operator==(const Corner&) const = default;
};

/// A face that names vertices which come later in the file.
struct LateFace {
  std::vector<Corner> corners;
  std::string group, material;
  std::string where;
};

/// True if a line begins with "vn".
bool gives_normals(std::string_view text) {
  for (std::size_t at = text.find("vn"); at != text.npos; at = text.find("vn", at + 2)) {
    const bool starts = at == 0 || is_space(text[at - 1]);
    if (starts && at + 2 < text.size() && is_space(text[at + 2])) return true;
  }
  return false;
}

/// Up to a comment at the line's end.
std::string_view uncommented(std::string_view line) { return line.substr(0, line.find('#')); }

class Reader {
 public:
  explicit Reader(Builder& builder)
      : builder_(builder),
        limits_(builder.options.limits),
        lines_(as_text(builder.bundle.model().bytes)) {}

  void read() {
    has_normals_ = gives_normals(without_mark(as_text(builder_.bundle.model().bytes)));
    while (auto line = lines_.next()) {
      std::string_view rest = *line;
      const std::string_view key = take_word(rest);
      if (key.empty() || key.starts_with('#')) continue;
      try {
        statement(key, rest);
      } catch (Refused& refused) {
        refused.error.where = lines_.where();
        throw;
      }
    }
    for (LateFace& face : late_faces_) add_late(std::move(face));
    if (mesh_.triangles.empty()) refuse("f", "the file has no faces");
    if (skipped_ > 0)
      builder_.warn(fmt::format("{} faces of fewer than 3 corners are left out", skipped_));
  }

  void build() {
    std::set<std::string> used;
    for (const auto& [key, part] : parts_) used.insert(key.second);
    std::map<std::string, Ref> materials = load_materials(builder_, libraries_, used);
    if (!builder_.complete()) return;
    std::vector<Ref> by_part(parts_.size());
    mesh_.part_names.resize(parts_.size());
    for (const auto& [key, part] : parts_) {
      by_part[part] = materials[key.second];
      const std::string& name = key.first.empty() ? key.second : key.first;
      mesh_.part_names[part] = clean_name(name, fmt::format("part_{}", part));
    }
    if (!any_uv_) mesh_.uvs.clear();
    if (!any_normal_) mesh_.normals.clear();
    finish_colors();
    put_model(builder_, {.mesh = std::move(mesh_),
                         .positions = std::move(placed_),
                         .materials = std::move(by_part),
                         .where = "mesh"});
  }

 private:
  void statement(std::string_view key, std::string_view rest) {
    if (key == "v") {
      position(uncommented(rest));
    } else if (key == "vt") {
      rest = uncommented(rest);
      const float u = number(rest);
      uvs_.emplace_back(u, trimmed(rest).empty() ? 0 : number(rest));
    } else if (key == "vn") {
      const float x = number(rest);
      const float y = number(rest);
      normals_.emplace_back(x, y, number(rest));
    } else if (key == "f" || key == "fo") {
      face(uncommented(rest));
    } else if (key == "o" || key == "g") {
      group_ = trimmed(rest);
      part_.reset();
    } else if (key == "usemtl") {
      material_ = trimmed(rest);
      part_.reset();
    } else if (key == "mtllib") {
      material_libraries(rest);
    } else if (key == "l" || key == "p") {
      builder_.warn("points and lines are left out");
    } else if (key.starts_with("curv") || key == "surf" || key == "cstype") {
      refuse_unimplemented("", "free-form curves and surfaces; tessellate them");
    }
  }

  /// Reads a number of a normal, a colour or a texture coordinate: 0 for what is not finite.
  float number(std::string_view& rest) {
    std::string_view ahead = rest;
    if (!is_no_number(take_word(ahead))) return take_number(rest, "");
    builder_.warn("normals, colours or texture coordinates that are not finite are taken as 0");
    rest = ahead;
    return 0;
  }

  void position(std::string_view rest) {
    const double x = take_double(rest, "");
    const double y = take_double(rest, "");
    positions_.emplace_back(x, y, take_double(rest, ""));
    Budget::check(positions_.size(), limits_.vertices, "vertices", "");
    float numbers[4] = {};
    int count = 0;
    while (count < 4 && !trimmed(rest).empty()) numbers[count++] = number(rest);
    if (count < 3) return;  // none, or a weight
    colors_.resize(positions_.size(), vec4(1));
    colors_.back() = vec4(numbers[0], numbers[1], numbers[2], 1);  // a fourth is alpha
  }

  /// Names may have spaces, and a line several names: each ends with ".mtl", or with the line.
  void material_libraries(std::string_view rest) {
    std::string name;
    while (!trimmed(rest).empty()) {
      const std::string_view word = take_word(rest);
      if (!name.empty()) name += ' ';
      name += word;
      if (!lower(word).ends_with(".mtl") && !lower(word).ends_with(".mtl\"")) continue;
      material_library(name);
      name.clear();
    }
    if (!name.empty()) material_library(name);
  }
  void material_library(std::string_view name) {
    const std::string path = Bundle::companion(builder_.bundle.model().path, name, "");
    if (!path.empty()) libraries_.push_back(path);
  }

  /// 1 is the first, which may come later in the file, -1 the last so far; kNone for what can be
  /// none.
  static u32 index(std::string_view text, std::size_t count) {
    const i64 value = parse<i64>(text).value_or(0);
    const i64 zero_based = value > 0 ? value - 1 : i64(count) + value;
    return value != 0 && zero_based >= 0 && zero_based < i64(kFlat) ? u32(zero_based) : kNone;
  }

  u32 position_index(std::string_view text) const {
    const u32 found = index(text, positions_.size());
    if (found != kNone) return found;
    // Errors are logged, and a log has nothing of a file: a number alone is quoted.
    if (!parse<i64>(text)) refuse("", "a face names a vertex by what is no number");
    refuse("", fmt::format("vertex '{}' is not one of the {} so far", text, positions_.size()));
  }
  /// Faces may do without vn and vt.
  u32 other_index(std::string_view text, std::size_t count) {
    const u32 found = index(text, count);
    if (found == kNone) warn_of_missing();
    return found;
  }
  void check_other(u32& other, std::size_t count) {
    if (other == kNone || other < count) return;
    other = kNone;
    warn_of_missing();
  }
  void warn_of_missing() {
    builder_.warn("faces name vn or vt that are not there: they go without");
  }

  Corner corner(std::string_view word) {
    const std::size_t first = std::min(word.find('/'), word.size());
    Corner result{.position = position_index(word.substr(0, first))};
    if (first == word.size()) return result;
    word.remove_prefix(first + 1);
    const std::size_t second = std::min(word.find('/'), word.size());
    if (second > 0) result.uv = other_index(word.substr(0, second), uvs_.size());
    if (second + 1 < word.size())
      result.normal = other_index(word.substr(second + 1), normals_.size());
    return result;
  }

  void face(std::string_view rest) {
    corners_.clear();
    while (!trimmed(rest).empty()) corners_.push_back(corner(take_word(rest)));
    const auto is_late = [&](const Corner& c) { return c.position >= positions_.size(); };
    if (std::ranges::none_of(corners_, is_late)) return add_face();
    builder_.budget.take(corners_.size(), sizeof(Corner), "");
    builder_.budget.take(1, sizeof(LateFace) + group_.size() + material_.size(), "");
    late_faces_.push_back({corners_, group_, material_, lines_.where()});
  }

  /// At the end of the file.
  void add_late(LateFace face) {
    for (const Corner& c : face.corners)
      if (c.position >= positions_.size())
        refuse(face.where, fmt::format("vertex '{}' is not one of the {}", u64(c.position) + 1,
                                       positions_.size()));
    corners_ = std::move(face.corners);
    group_ = std::move(face.group);
    material_ = std::move(face.material);
    part_.reset();
    add_face();
  }

  void add_face() {
    polygon_.clear();
    bool all_normals = true;
    for (Corner& c : corners_) {
      check_other(c.uv, uvs_.size());
      check_other(c.normal, normals_.size());
      polygon_.push_back(positions_[c.position]);
      all_normals &= c.normal != kNone;
    }
    if (corners_.size() < 3) {
      ++skipped_;
      return;
    }
    any_normal_ |= all_normals;
    if (!all_normals) give_flat_normal();
    triangulate(polygon_, local_);
    Budget::check(mesh_.triangles.size() + local_.size(), limits_.triangles, "triangles", "");
    if (!part_) part_ = parts_.try_emplace({group_, material_}, u32(parts_.size())).first->second;
    for (const uvec3& t : local_) {
      const u32 a = vertex(corners_[t.x]);
      const u32 b = vertex(corners_[t.y]);
      mesh_.triangles.emplace_back(a, b, vertex(corners_[t.z]));
      mesh_.parts.push_back(*part_);
    }
  }

  /// In a file with normals, a face without takes its own.
  void give_flat_normal() {
    if (!has_normals_) return;
    flat_normals_.emplace_back(normal_of(polygon_));
    for (Corner& c : corners_) c.normal = kFlat | u32(flat_normals_.size() - 1);
  }

  [[nodiscard]] vec3 normal(const Corner& c) const {
    if (c.normal == kNone) return vec3(0);
    return c.normal & kFlat ? flat_normals_[c.normal & ~kFlat] : normals_[c.normal];
  }

  u32 vertex(const Corner& c) {
    const auto [at, is_new] = vertices_.try_emplace(c, u32(placed_.size()));
    if (!is_new) return at->second;
    Budget::check(placed_.size() + 1, limits_.vertices, "vertices", "");
    placed_.push_back(positions_[c.position]);
    mesh_.uvs.push_back(c.uv == kNone ? vec2(0) : uvs_[c.uv]);
    mesh_.normals.push_back(normal(c));
    mesh_.colors.push_back(c.position < colors_.size() ? colors_[c.position] : vec4(1));
    any_uv_ |= c.uv != kNone;
    return at->second;
  }

  /// They are sRGB; a vertex without one is white.
  void finish_colors() {
    if (colors_.empty()) mesh_.colors.clear();
    clamp_colors(mesh_.colors, builder_);
    make_linear(mesh_.colors);
  }

  Builder& builder_;
  const LoadLimits& limits_;
  Lines lines_;
  std::vector<glm::dvec3> positions_, placed_;  // of the file, of the mesh
  std::vector<vec3> normals_, flat_normals_;
  std::vector<vec2> uvs_;
  std::vector<vec4> colors_;
  std::vector<std::string> libraries_;
  std::string group_, material_;
  std::optional<u32> part_;
  std::map<std::pair<std::string, std::string>, u32> parts_;  // (group, material)
  std::unordered_map<Corner, u32, VertexHash> vertices_;
  std::vector<Corner> corners_;
  std::vector<LateFace> late_faces_;
  std::vector<glm::dvec3> polygon_;
  std::vector<uvec3> local_;
  MeshData mesh_;
  u64 skipped_ = 0;
  bool has_normals_ = false, any_uv_ = false, any_normal_ = false;
};

}  // namespace

void load_obj(Builder& builder) {
  Reader reader(builder);
  reader.read();
  reader.build();
}

}  // namespace heliograph::assets
