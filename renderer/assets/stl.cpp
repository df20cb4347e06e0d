// STL, ASCII and binary. Equal vertices are welded; shading is flat. Chosen by load.cpp.
#include <algorithm>
#include <array>
#include <cstring>
#include <unordered_map>

#include "renderer/assets/model.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

constexpr std::size_t kHeaderBytes = 84;
constexpr std::size_t kFacetBytes = 50;

/// Makes one vertex of equal positions.
class Welder {
 public:
  u32 vertex(glm::dvec3 p, const std::string& where) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
      refuse(where, "a vertex is not finite");
    }
    p += 0.0;  // -0 equals 0
    const auto [at, is_new] = known_.try_emplace(p, u32(model.positions.size()));
    if (is_new) model.positions.push_back(p);
    return at->second;
  }
  void triangle(u32 a, u32 b, u32 c) { model.mesh.triangles.emplace_back(a, b, c); }
  Model model{.mesh = {}, .positions = {}, .materials = {}, .where = "facets"};

 private:
  std::unordered_map<glm::dvec3, u32, VertexHash> known_;
};

u32 facets_of(std::span<const std::byte> bytes) {
  u32 count;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  return count;
}

u64 facets_in(std::span<const std::byte> bytes) {
  return (bytes.size() - kHeaderBytes) / kFacetBytes;
}

/// Begins with "solid" and has characters only: the facets of a binary file are counted in four
/// bytes of which one is 0, and many of these files begin with "solid" too.
bool is_ascii(std::span<const std::byte> bytes) {
  constexpr std::size_t kLooked = 1024;
  const std::string_view text = without_mark(as_text(bytes.first(std::min(kLooked, bytes.size()))));
  return lower(trimmed(text).substr(0, 5)) == "solid" && !has_controls(text);
}

/// As the header has it, but for programs that leave the count at 0.
u64 count_facets(Builder& builder) {
  const auto bytes = builder.bundle.model().bytes;
  if (bytes.size() < kHeaderBytes || facets_of(bytes) > facets_in(bytes))
    refuse("facets", "is neither binary STL of its size nor ASCII STL; the file may be truncated");
  if (facets_of(bytes) > 0 && facets_of(bytes) < facets_in(bytes))
    builder.warn(fmt::format("the header counts {} facets; the {} behind them are left out",
                             facets_of(bytes), facets_in(bytes) - facets_of(bytes)));
  if (facets_of(bytes) > 0 || facets_in(bytes) == 0) return facets_of(bytes);
  builder.warn(
      fmt::format("the header counts no facets; the {} behind it are read", facets_in(bytes)));
  return facets_in(bytes);
}

Model read_binary(Builder& builder) {
  const auto bytes = builder.bundle.model().bytes;
  const u64 count = count_facets(builder);
  Budget::check(count, builder.options.limits.triangles, "triangles", "facets");
  builder.budget.take(count, sizeof(uvec3) + 3 * sizeof(vec3), "facets");
  Welder welder;
  bool has_colors = false;
  for (u64 i = 0; i < count; ++i) {
    std::array<vec3, 3> corners;
    const std::byte* facet = bytes.data() + kHeaderBytes + kFacetBytes * i;
    has_colors = has_colors || (facet[kFacetBytes - 1] & std::byte{0x80}) != std::byte{0};
    std::memcpy(corners.data(), facet + 12, sizeof corners);
    const std::string where = fmt::format("facet {}", i);
    const u32 a = welder.vertex(corners[0], where);
    const u32 b = welder.vertex(corners[1], where);
    welder.triangle(a, b, welder.vertex(corners[2], where));
  }
  if (has_colors) builder.warn("colours of facets are left out");
  return std::move(welder.model);
}

/// Statements of ASCII STL, which need not be on lines of their own.
class AsciiReader {
 public:
  explicit AsciiReader(Builder& builder)
      : builder_(builder), lines_(as_text(builder.bundle.model().bytes)) {}

  Model read() {
    while (auto line = lines_.next()) {
      std::string_view rest = *line;
      while (!rest.empty()) statement(lower(take_word(rest)), rest);
    }
    if (!corners_.empty()) refuse(lines_.where(), "the file is truncated");
    return std::move(welder_.model);
  }

 private:
  void statement(const std::string& key, std::string_view& rest) {
    if (key == "vertex") {
      const double x = take_double(rest, lines_.where());
      const double y = take_double(rest, lines_.where());
      const double z = take_double(rest, lines_.where());
      corners_.push_back(welder_.vertex({x, y, z}, lines_.where()));
    } else if (key == "outer") {
      corners_.clear();
    } else if (key == "endloop") {
      facet();
    } else if (key == "solid" || key == "endsolid") {  // a name follows
      rest.remove_prefix(std::min(lower(rest).find("facet"), rest.size()));
    }
  }
  void facet() {
    if (corners_.size() != 3)
      refuse(lines_.where(), fmt::format("a facet has {} vertices, not 3", corners_.size()));
    welder_.triangle(corners_[0], corners_[1], corners_[2]);
    corners_.clear();
    Budget::check(welder_.model.mesh.triangles.size(), builder_.options.limits.triangles,
                  "triangles", lines_.where());
  }

  Builder& builder_;
  Lines lines_;
  Welder welder_;
  std::vector<u32> corners_;
};

}  // namespace

void load_stl(Builder& builder) {
  const bool ascii = is_ascii(builder.bundle.model().bytes);
  put_model(builder, ascii ? AsciiReader(builder).read() : read_binary(builder));
}

}  // namespace heliograph::assets
