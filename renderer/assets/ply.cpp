// PLY, ASCII and binary of both byte orders: polygons with normals, texture coordinates, colours.
// Chosen by load.cpp. Source: Turk 1994, "The PLY Polygon File Format".
#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

enum class Type : u8 { kI8, kU8, kI16, kU16, kI32, kU32, kF32, kF64 };
constexpr std::array<u8, 8> kTypeBytes = {1, 1, 2, 2, 4, 4, 4, 8};

Type type_of(std::string_view name, const std::string& where) {
  constexpr std::array<std::array<std::string_view, 2>, 8> kNames = {{{"char", "int8"},
                                                                      {"uchar", "uint8"},
                                                                      {"short", "int16"},
                                                                      {"ushort", "uint16"},
                                                                      {"int", "int32"},
                                                                      {"uint", "uint32"},
                                                                      {"float", "float32"},
                                                                      {"double", "float64"}}};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (std::ranges::find(kNames[i], name) != kNames[i].end()) return Type(i);
  }
  refuse(where, fmt::format("'{}' is not a PLY type", clean_name(name, "")));
}

struct Property {
  std::string name;
  Type type = Type::kF32;
  std::optional<Type> count;  // of a list
};
struct Element {
  std::string name;
  u64 count = 0;
  std::vector<Property> properties;
};

enum class Encoding : u8 { kAscii, kLittle, kBig };

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::size_t size = 0;
};

u64 parse_count(std::string_view word, const std::string& where) {
  u64 value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) {
    refuse(where, "the count is not a whole number");
  }
  return value;
}

void header_line(std::string_view line, const std::string& where, Header& header) {
  const std::string_view key = take_word(line);
  if (key == "format") {
    const std::string_view name = take_word(line);
    if (name == "binary_little_endian") {
      header.encoding = Encoding::kLittle;
    } else if (name == "binary_big_endian") {
      header.encoding = Encoding::kBig;
    } else if (name != "ascii") {
      refuse(where, "the format is not ascii, binary_little_endian or binary_big_endian");
    }
  } else if (key == "element") {
    const std::string name(take_word(line));
    header.elements.push_back({name, parse_count(take_word(line), where), {}});
  } else if (key == "property") {
    if (header.elements.empty()) refuse(where, "a property comes before any element");
    Property property;
    std::string_view type = take_word(line);
    if (type == "list") {
      property.count = type_of(take_word(line), where);
      type = take_word(line);
    }
    property.type = type_of(type, where);
    property.name = take_word(line);
    header.elements.back().properties.push_back(std::move(property));
  } else if (key != "comment" && key != "obj_info" && !key.empty()) {
    refuse(where, fmt::format("'{}' is not a PLY header line", clean_name(key, "")));
  }
}

Header read_header(std::string_view text) {
  Header header;
  u32 number = 0;
  while (true) {
    const std::size_t end = text.find('\n', header.size);
    if (end == text.npos) refuse("header", "end_header is missing");
    const std::string_view line = trimmed(text.substr(header.size, end - header.size));
    header.size = end + 1;
    ++number;
    if (number == 1 && line != "ply") refuse("line 1", "a PLY file begins with 'ply'");
    if (line == "end_header") return header;
    if (number > 1) header_line(line, fmt::format("line {}", number), header);
  }
}

/// The numbers after the header, one by one.
class Numbers {
 public:
  Numbers(std::string_view rest, Encoding encoding) : rest_(rest), encoding_(encoding) {}

  double next(Type type) {
    if (encoding_ == Encoding::kAscii) return ascii();
    const std::size_t size = kTypeBytes[std::size_t(type)];
    if (size > rest_.size()) refuse("data", "the file is truncated");
    std::array<char, 8> bytes{};
    const bool same =
        (std::endian::native == std::endian::little) == (encoding_ == Encoding::kLittle);
    for (std::size_t i = 0; i < size; ++i) bytes[i] = rest_[same ? i : size - 1 - i];
    rest_.remove_prefix(size);
    return value(bytes, type);
  }
  u64 next_count(Type type) {
    const double number = next(type);
    if (!(number >= 0) || number > 4294967295.0 || number != std::floor(number)) {
      refuse("data", "a count or an index is not a whole number, 0 or more");
    }
    return u64(number);
  }
  /// Whether `count` more of at least `bytes` each can be there.
  [[nodiscard]] bool has(u64 count, u64 bytes) const {
    return count <= rest_.size() / std::max<u64>(bytes, 1);
  }

 private:
  double ascii() {
    const std::string_view word = take_word(rest_);
    if (word.empty()) refuse("data", "the file is truncated");
    double number = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
    if (error != std::errc() || end != word.data() + word.size()) {
      refuse("data", fmt::format("'{}' is not a number", clean_name(word, "")));
    }
    return number;
  }
  template <class T>
  static double as(const std::array<char, 8>& bytes) {
    T number;
    std::memcpy(&number, bytes.data(), sizeof number);
    return double(number);
  }
  static double value(const std::array<char, 8>& bytes, Type type) {
    switch (type) {
      case Type::kI8:
        return as<std::int8_t>(bytes);
      case Type::kU8:
        return as<u8>(bytes);
      case Type::kI16:
        return as<std::int16_t>(bytes);
      case Type::kU16:
        return as<u16>(bytes);
      case Type::kI32:
        return as<i32>(bytes);
      case Type::kU32:
        return as<u32>(bytes);
      case Type::kF32:
        return as<float>(bytes);
      case Type::kF64:
        return as<double>(bytes);
    }
    return 0;
  }
  std::string_view rest_;
  Encoding encoding_;
};

/// What a vertex property means: an index into a row of twelve numbers; -1: nothing to us.
constexpr std::size_t kSlots = 12;
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

class Reader {
 public:
  explicit Reader(Builder& builder) : builder_(builder) {}

  MeshData read() {
    const std::string_view text = as_text(builder_.bundle.model().bytes);
    const Header header = read_header(text);
    Numbers numbers(text.substr(header.size), header.encoding);
    for (const Element& element : header.elements) {
      if (element.name == "vertex") {
        read_vertices(element, numbers);
      } else if (element.name == "face") {
        read_faces(element, numbers);
      } else if (element.name == "tristrips") {
        refuse_unimplemented("element tristrips", "triangle strips; export a list of faces");
      } else {
        skip(element, numbers);
      }
    }
    if (mesh_.triangles.empty()) {
      refuse("element face", "the file has no faces; point clouds are not rendered");
    }
    if (empty_faces_ > 0) {
      builder_.warn(fmt::format("{} faces of fewer than 3 corners are left out", empty_faces_));
    }
    return std::move(mesh_);
  }

 private:
  static double skip_property(const Property& property, Numbers& numbers) {
    if (!property.count) return numbers.next(property.type);
    for (u64 left = numbers.next_count(*property.count); left > 0; --left) {
      (void)numbers.next(property.type);
    }
    return 0;
  }
  static void skip(const Element& element, Numbers& numbers) {
    if (element.properties.empty()) return;
    for (u64 i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) (void)skip_property(property, numbers);
    }
  }

  /// Bytes or characters that one of the element takes at least.
  static u64 smallest(const Element& element) {
    return std::max<u64>(element.properties.size(), 1);
  }

  void read_vertices(const Element& element, Numbers& numbers) {
    Budget::check(element.count, builder_.options.limits.vertices, "vertices", "element vertex");
    if (!numbers.has(element.count, smallest(element))) refuse("data", "the file is truncated");
    builder_.budget.take(element.count, kSlots * sizeof(float), "element vertex");
    std::vector<int> slots;
    for (const Property& property : element.properties) {
      slots.push_back(property.count ? -1 : slot_of(property.name));
    }
    const auto has = [&](int first, int count) {
      for (int slot = first; slot < first + count; ++slot) {
        if (std::ranges::find(slots, slot) == slots.end()) return false;
      }
      return true;
    };
    const bool normals = has(3, 3), uvs = has(6, 2), colors = has(8, 3);
    if (!has(0, 3)) refuse("element vertex", "has no x, y, z");
    for (u64 i = 0; i < element.count; ++i) {
      std::array<float, kSlots> row{};
      row[11] = 1;
      for (std::size_t k = 0; k < slots.size(); ++k) {
        const Property& property = element.properties[k];
        const double number = skip_property(property, numbers);
        if (slots[k] < 0) continue;
        row[std::size_t(slots[k])] =
            slots[k] < 8 ? float(number) : color(number, property, slots[k]);
      }
      for (const float number : row) {
        if (!std::isfinite(number)) refuse(fmt::format("vertex {}", i), "a number is not finite");
      }
      mesh_.positions.emplace_back(row[0], row[1], row[2]);
      if (normals) mesh_.normals.emplace_back(row[3], row[4], row[5]);
      if (uvs) mesh_.uvs.emplace_back(row[6], row[7]);
      if (colors) mesh_.colors.emplace_back(row[8], row[9], row[10], row[11]);
    }
  }

  /// Integers are sRGB, floats linear; alpha is linear always.
  static float color(double number, const Property& property, int slot) {
    if (property.type == Type::kF32 || property.type == Type::kF64) return float(number);
    const double largest = property.type == Type::kU16 || property.type == Type::kI16 ? 65535 : 255;
    const auto unit = float(std::clamp(number / largest, 0.0, 1.0));
    return slot == 11 ? unit : linear_from_srgb(unit);
  }

  void read_faces(const Element& element, Numbers& numbers) {
    Budget::check(element.count, builder_.options.limits.triangles, "triangles", "element face");
    if (!numbers.has(element.count, smallest(element))) refuse("data", "the file is truncated");
    const auto is_indices = [](const Property& p) {
      return p.count && (p.name == "vertex_indices" || p.name == "vertex_index");
    };
    if (std::ranges::none_of(element.properties, is_indices)) {
      if (element.count > 0) refuse("element face", "has no list vertex_indices");
      return;
    }
    for (u64 i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) {
        if (is_indices(property)) {
          read_face(property, i, numbers);
        } else {
          if (property.count)
            builder_.warn("lists of faces other than vertex_indices are left out");
          (void)skip_property(property, numbers);
        }
      }
    }
  }

  void read_face(const Property& property, u64 face, Numbers& numbers) {
    const u64 corners = numbers.next_count(*property.count);
    if (!numbers.has(corners, 1)) refuse("data", "the file is truncated");
    indices_.clear();
    polygon_.clear();
    for (u64 k = 0; k < corners; ++k) {
      const u64 index = numbers.next_count(property.type);
      if (index >= mesh_.positions.size()) {
        refuse(fmt::format("face {}", face),
               fmt::format("index {} is not below the {} vertices", index, mesh_.positions.size()));
      }
      indices_.push_back(u32(index));
      polygon_.push_back(mesh_.positions[index]);
    }
    if (corners < 3) {
      ++empty_faces_;
      return;
    }
    if (corners == 3) {
      add(uvec3(indices_[0], indices_[1], indices_[2]));
      return;
    }
    local_.clear();
    triangulate(polygon_, local_);
    for (const uvec3& t : local_) add(uvec3(indices_[t.x], indices_[t.y], indices_[t.z]));
  }

  void add(const uvec3& triangle) {
    Budget::check(mesh_.triangles.size() + 1, builder_.options.limits.triangles, "triangles",
                  "element face");
    mesh_.triangles.push_back(triangle);
  }

  Builder& builder_;
  MeshData mesh_;
  std::vector<u32> indices_;
  std::vector<vec3> polygon_;
  std::vector<uvec3> local_;
  u64 empty_faces_ = 0;
};

}  // namespace

void load_ply(Builder& builder) {
  MeshData mesh = Reader(builder).read();
  to_world_axes(mesh, builder.options);
  const bool colored = !mesh.colors.empty();
  PutEntity root;
  if (colored) {  // the colours are the colour, not a tint of the default grey
    PutMaterial white;
    white.parameters[std::size_t(MaterialParameter::base_color)].value = vec3(1);
    root.materials = std::vector<Ref>{
        builder.library(builder.claim_name("vertex_colors", "vertex_colors"), white)};
  }
  const std::string stem = stem_of(builder.bundle.model().path);
  root.mesh = builder.library(builder.claim_name(stem, "mesh"),
                              finish_mesh(std::move(mesh), "mesh", builder.budget));
  builder.entity("", std::move(root));
}

}  // namespace heliograph::assets
