// PLY, ASCII and binary of both byte orders: polygons with normals, texture coordinates, colours
// and textures. Chosen by load.cpp. Source: Turk 1994, "The PLY Polygon File Format"; `comment
// TextureFile`, `texcoord` and `texnumber` as MeshLab writes them.
#include "renderer/assets/ply_header.h"

#include <algorithm>
#include <unordered_map>
#include <utility>

#include "renderer/assets/model.h"
#include "renderer/assets/polygon.h"
#include "renderer/assets/text_scan.h"
#include "renderer/assets/texture_files.h"

namespace heliograph::assets {
namespace {

using namespace ply;

/// Meaning of a property: an index into a row of twelve numbers; -1: nothing to us.
constexpr std::size_t kSlots = 12;
constexpr int kNormal = 3, kUv = 6, kColor = 8, kAlpha = 11;
using Row = std::array<double, kSlots>;

int slot_of(const std::string& name) {
  constexpr std::array<std::array<std::string_view, 4>, kSlots> kNames = {{
      {"x"},
      {"y"},
      {"z"},
      {"nx", "normal_x"},
      {"ny", "normal_y"},
      {"nz", "normal_z"},
      {"s", "u", "texture_u", "s0"},
      {"t", "v", "texture_v", "t0"},
      {"red", "r", "diffuse_red"},
      {"green", "g", "diffuse_green"},
      {"blue", "b", "diffuse_blue"},
      {"alpha", "a", "diffuse_alpha"},
  }};
  for (std::size_t i = 0; i < kSlots; ++i) {
    if (!name.empty() && std::ranges::find(kNames[i], name) != kNames[i].end()) return int(i);
  }
  return -1;
}

/// The slot of each property of an element.
std::vector<int> slots_of(const Element& element) {
  std::vector<int> slots;
  for (const Property& property : element.properties)
    slots.push_back(property.count ? -1 : slot_of(property.name));
  return slots;
}

bool has_slots(const std::vector<int>& slots, int first, int count) {
  for (int slot = first; slot < first + count; ++slot)
    if (std::ranges::find(slots, slot) == slots.end()) return false;
  return true;
}

/// Integers are sRGB, floats linear; alpha is linear always.
double color_of(double number, const Property& property, int slot) {
  if (property.type == Type::kF32 || property.type == Type::kF64) return number;
  const double largest = property.type == Type::kU16 || property.type == Type::kI16 ? 65535 : 255;
  const auto unit = float(std::clamp(number / largest, 0.0, 1.0));
  return slot == kAlpha ? unit : linear_from_srgb(unit);
}

bool is_indices(const Property& p) {
  return p.count && (p.name == "vertex_indices" || p.name == "vertex_index");
}
bool is_texcoord(const Property& p) { return p.count && p.name == "texcoord"; }

/// A vertex as a face has it, where faces have colours or texture coordinates of their own.
struct Wedge {
  u32 vertex = 0;
  vec2 uv{0};
  vec4 color{1};
  bool operator==(const Wedge&) const = default;
};

class Reader {
 public:
  Reader(Builder& builder, const Header& header) : builder_(builder), header_(header) {}

  Model read(std::string_view data) {
    const auto place = [&](const char* name) {
      return std::ranges::find(header_.elements, name, &Element::name) - header_.elements.begin();
    };
    const bool is_in_order = place("vertex") <= std::min(place("face"), place("tristrips"));
    read_elements(data, true, is_in_order);
    if (!is_in_order) read_elements(data, false, true);
    if (mesh_.triangles.empty()) {
      refuse("element face", "the file has no faces; point clouds are not rendered");
    }
    if (empty_faces_ > 0) {
      builder_.warn(fmt::format("{} faces of fewer than 3 corners are left out", empty_faces_));
    }
    if (own_uvs_ || own_colors_) split();
    return {.mesh = std::move(mesh_),
            .positions = std::move(positions_),
            .materials = {},
            .where = "mesh"};
  }

 private:
  void read_elements(std::string_view data, bool vertices, bool faces) {
    Numbers numbers(data, header_.encoding);
    for (const Element& element : header_.elements) {
      if (element.name == "vertex" && vertices) {
        read_vertices(element, numbers);
      } else if (element.name == "face" && faces) {
        read_faces(element, numbers);
      } else if (element.name == "tristrips" && faces) {
        read_strips(element, numbers);
      } else {
        skip(element, numbers);
      }
    }
  }
  static double skip_property(const Property& property, Numbers& numbers) {
    if (!property.count) return numbers.next(property.type);
    for (u64 left = numbers.next_count(*property.count); left > 0; --left) {
      (void)numbers.next(property.type);
    }
    return 0;
  }
  void skip(const Element& element, Numbers& numbers) {
    if (element.properties.empty()) return;
    for (u64 i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) (void)skip_property(property, numbers);
      end_element(numbers);
    }
  }
  /// Some programs write a list where their header has a single number.
  void end_element(Numbers& numbers) {
    if (numbers.end_element())
      builder_.warn("lines have more numbers than the header says: these are left out");
  }

  /// Refuses an element that the file cannot hold, each at least a byte or character per property.
  static void check_size(const Element& element, const Numbers& numbers) {
    if (!numbers.has(element.count, std::max<u64>(element.properties.size(), 1)))
      refuse("data", "the file is truncated");
  }

  static void set(Row& row, int slot, const Property& property, double number) {
    if (slot >= 0)
      row[std::size_t(slot)] = slot < kColor ? number : color_of(number, property, slot);
  }

  void read_vertices(const Element& element, Numbers& numbers) {
    Budget::check(element.count, builder_.options.limits.vertices, "vertices", "element vertex");
    check_size(element, numbers);
    builder_.budget.take(element.count, kSlots * sizeof(float), "element vertex");
    const std::vector<int> slots = slots_of(element);
    if (!has_slots(slots, 0, 3)) refuse("element vertex", "has no x, y, z");
    const bool normals = has_slots(slots, kNormal, 3);
    const bool uvs = has_slots(slots, kUv, 2), colors = has_slots(slots, kColor, 3);
    for (u64 i = 0; i < element.count; ++i) {
      Row row{};
      row[kAlpha] = 1;
      for (std::size_t k = 0; k < slots.size(); ++k) {
        const double number = skip_property(element.properties[k], numbers);
        set(row, slots[k], element.properties[k], number);
      }
      end_element(numbers);
      check_numbers(row, i);
      positions_.emplace_back(row[0], row[1], row[2]);
      if (normals) mesh_.normals.emplace_back(row[3], row[4], row[5]);
      if (uvs) mesh_.uvs.emplace_back(row[6], row[7]);
      if (colors) mesh_.colors.emplace_back(row[8], row[9], row[10], row[11]);
    }
  }

  /// All but positions may be no number, and are 0 then.
  void check_numbers(Row& row, u64 vertex) {
    for (std::size_t k = 0; k < kSlots; ++k) {
      if (std::isfinite(float(row[k]))) continue;
      if (k < kNormal) refuse(fmt::format("vertex {}", vertex), "a number is not finite");
      row[k] = 0;
      builder_.warn("normals, colours or texture coordinates that are not finite are taken as 0");
    }
  }

  void read_faces(const Element& element, Numbers& numbers) {
    Budget::check(element.count, builder_.options.limits.triangles, "triangles", "element face");
    check_size(element, numbers);
    if (std::ranges::none_of(element.properties, is_indices)) {
      if (element.count > 0) refuse("element face", "has no list vertex_indices");
      return;
    }
    const std::vector<int> slots = slots_of(element);
    own_colors_ = has_slots(slots, kColor, 3);
    own_uvs_ = std::ranges::any_of(element.properties, is_texcoord);
    for (u64 i = 0; i < element.count; ++i) {
      Row row{};
      row[kAlpha] = 1;
      texcoords_.clear();
      texture_ = 0;
      for (std::size_t k = 0; k < slots.size(); ++k) {
        const Property& property = element.properties[k];
        if (is_indices(property)) {
          read_indices(property, i, numbers);
        } else if (is_texcoord(property)) {
          read_texcoords(property, numbers);
        } else {
          if (property.count)
            builder_.warn("lists of faces other than vertex_indices and texcoord are left out");
          const double number = skip_property(property, numbers);
          if (property.name == "texnumber" && number > 0) texture_ = u32(std::min(number, 1e6));
          set(row, slots[k], property, number);
        }
      }
      end_element(numbers);
      add_face(vec4(row[8], row[9], row[10], row[11]));
    }
  }

  void read_indices(const Property& property, u64 face, Numbers& numbers) {
    const u64 corners = numbers.next_count(*property.count);
    if (!numbers.has(corners, 1)) refuse("data", "the file is truncated");
    indices_.clear();
    for (u64 k = 0; k < corners; ++k) {
      const u64 index = numbers.next_count(property.type);
      if (index >= positions_.size()) {
        refuse(fmt::format("face {}", face),
               fmt::format("index {} is not below the {} vertices", index, positions_.size()));
      }
      indices_.push_back(u32(index));
    }
  }

  void read_strips(const Element& element, Numbers& numbers) {
    check_size(element, numbers);
    texcoords_.clear();
    for (u64 i = 0; i < element.count; ++i, end_element(numbers))
      for (const Property& property : element.properties) {
        u64 left = is_indices(property) ? numbers.next_count(*property.count) : 0;
        if (!is_indices(property)) (void)skip_property(property, numbers);
        for (strip_.clear(); left > 0; --left) add_to_strip(numbers.next(property.type));
      }
  }

  void add_to_strip(double index) {
    if (!(index >= 0)) return strip_.clear();  // -1 ends a strip
    if (index >= double(positions_.size()))
      refuse("element tristrips", fmt::format("index {} is of no vertex", index));
    strip_.push_back(u32(index));
    if (strip_.size() < 3) return;
    indices_.assign(strip_.end() - 3, strip_.end());
    if (strip_.size() % 2 == 0) std::swap(indices_[0], indices_[1]);
    const uvec3 t(indices_[0], indices_[1], indices_[2]);
    if (t.x != t.y && t.y != t.z && t.z != t.x) add_face(vec4(1));
  }

  void read_texcoords(const Property& property, Numbers& numbers) {
    const u64 count = numbers.next_count(*property.count);
    if (!numbers.has(count, 1)) refuse("data", "the file is truncated");
    for (u64 k = 0; k < count; ++k) {
      const auto number = float(numbers.next(property.type));
      texcoords_.push_back(std::isfinite(number) ? number : 0);
    }
  }

  void add_face(const vec4& color) {
    if (indices_.size() < 3) {
      ++empty_faces_;
      return;
    }
    polygon_.clear();
    for (const u32 index : indices_) polygon_.push_back(positions_[index]);
    triangulate(polygon_, local_);
    Budget::check(mesh_.triangles.size() + local_.size(), builder_.options.limits.triangles,
                  "triangles", "element face");
    if (own_uvs_ || own_colors_) take_wedges(color);
    for (const uvec3& t : local_)
      mesh_.triangles.emplace_back(indices_[t.x], indices_[t.y], indices_[t.z]);
    if (header_.textures.size() > 1)
      mesh_.parts.resize(mesh_.triangles.size(),
                         std::min(texture_, u32(header_.textures.size() - 1)));
  }

  /// Puts wedges in the place of the face's vertices.
  void take_wedges(const vec4& color) {
    for (std::size_t k = 0; k < indices_.size(); ++k) {
      Wedge wedge{.vertex = indices_[k]};
      if (2 * k + 1 < texcoords_.size()) wedge.uv = {texcoords_[2 * k], texcoords_[2 * k + 1]};
      if (own_colors_) wedge.color = color;
      const auto [at, is_new] = known_.try_emplace(wedge, u32(wedges_.size()));
      Budget::check(wedges_.size() + 1, builder_.options.limits.vertices, "vertices",
                    "element face");
      if (is_new) wedges_.push_back(wedge);
      indices_[k] = at->second;
    }
  }

  /// From here on every wedge is a vertex.
  void split() {
    const auto spread = [&](auto& values) {
      if (values.empty()) return;
      auto old = std::exchange(values, {});
      for (const Wedge& wedge : wedges_) values.push_back(old[wedge.vertex]);
    };
    if (own_uvs_) mesh_.uvs.clear();
    if (own_colors_) mesh_.colors.clear();
    spread(positions_);
    spread(mesh_.normals);
    spread(mesh_.uvs);
    spread(mesh_.colors);
    for (const Wedge& wedge : wedges_) {
      if (own_uvs_) mesh_.uvs.push_back(wedge.uv);
      if (own_colors_) mesh_.colors.push_back(wedge.color);
    }
  }

  Builder& builder_;
  const Header& header_;
  MeshData mesh_;
  std::vector<glm::dvec3> positions_;
  std::vector<u32> indices_, strip_;  // of the face
  std::vector<float> texcoords_;      // of the face
  u32 texture_ = 0;                   // of the face
  std::vector<glm::dvec3> polygon_;
  std::vector<uvec3> local_;
  std::vector<Wedge> wedges_;
  std::unordered_map<Wedge, u32, VertexHash> known_;
  bool own_uvs_ = false, own_colors_ = false;  // of faces
  u64 empty_faces_ = 0;
};

bool has_uvs(const Header& header) {
  return std::ranges::any_of(header.elements, [](const Element& element) {
    return (element.name == "vertex" && has_slots(slots_of(element), kUv, 2)) ||
           (element.name == "face" && std::ranges::any_of(element.properties, is_texcoord));
  });
}

/// A material for each texture that the header names.
std::vector<Ref> load_textures(Builder& builder, const Header& header) {
  const std::string& model = builder.bundle.model().path;
  TextureFiles files(builder);
  std::vector<std::pair<std::string, PutMaterial>> puts;
  for (const std::string& name : header.textures) {
    PutMaterial put;
    ParameterPatch& color = put.parameters[std::size_t(MaterialParameter::base_color)];
    color.value = vec3(1);
    const std::string path = Bundle::companion(model, name, "comment TextureFile");
    if (!path.empty())
      color.texture = files.use({.path = path, .where = "comment TextureFile", .srgb = true});
    puts.emplace_back(builder.claim_name(stem_of(path), "material"), std::move(put));
  }
  std::vector<Ref> materials;
  if (!builder.complete()) return materials;
  for (auto& [name, put] : puts) materials.push_back(builder.library(name, std::move(put)));
  return materials;
}

/// Finishes the colours of faces or vertices. A texture has them in it: beside it they are dropped.
void finish_colors(Model& model, Builder& builder) {
  std::vector<vec4>& colors = model.mesh.colors;
  if (!colors.empty() && !model.materials.empty()) {
    builder.warn("colours of vertices are left out beside a texture");
    colors.clear();
  }
  if (clamp_colors(colors, builder)) make_linear(colors);
}

}  // namespace

void load_ply(Builder& builder) {
  const std::string_view text = as_text(builder.bundle.model().bytes);
  const Header header = read_header(text);
  for (const std::string& word : header.unread)
    builder.warn(fmt::format("'{}' begins no line of a PLY header: it is left out", word));
  const bool textured = has_uvs(header) && !header.textures.empty();
  if (!textured && !header.textures.empty())
    builder.warn("TextureFile without texture coordinates is left out");
  std::vector<Ref> materials = textured ? load_textures(builder, header) : std::vector<Ref>();
  if (!builder.complete()) return;
  Model model = Reader(builder, header).read(text.substr(header.size));
  model.materials = std::move(materials);
  if (header.textures.size() > 1 && textured) {
    for (std::size_t i = 0; i < header.textures.size(); ++i)
      model.mesh.part_names.push_back(clean_name(header.textures[i], fmt::format("part_{}", i)));
  }
  finish_colors(model, builder);
  put_model(builder, std::move(model));
}

}  // namespace heliograph::assets
