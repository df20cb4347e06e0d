// STL, ASCII and binary. Equal vertices are welded; shading is flat. Chosen by load.cpp.
#include <array>
#include <cstring>
#include <unordered_map>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

constexpr std::size_t kHeaderBytes = 84;
constexpr std::size_t kFacetBytes = 50;

using Bits = std::array<u32, 3>;
struct BitsHash {
  std::size_t operator()(const Bits& b) const {
    u64 h = (u64(b[0]) << 32 | b[1]) * 0x9E3779B97F4A7C15ull;
    h ^= h >> 29;
    return std::size_t((h ^ b[2]) * 0xBF58476D1CE4E5B9ull);
  }
};

/// Makes one vertex of equal positions.
class Welder {
 public:
  u32 vertex(vec3 p, const std::string& where) {
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) {
      refuse(where, "a vertex is not finite");
    }
    p += 0.0f;  // -0 equals 0
    Bits bits;
    std::memcpy(bits.data(), &p, sizeof bits);
    const auto [at, is_new] = known_.try_emplace(bits, u32(mesh.positions.size()));
    if (is_new) mesh.positions.push_back(p);
    return at->second;
  }
  MeshData mesh;

 private:
  std::unordered_map<Bits, u32, BitsHash> known_;
};

u32 facets_of(std::span<const std::byte> bytes) {
  u32 count;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  return count;
}

/// Binary by its size: many binary files begin with "solid" too.
bool is_binary(std::span<const std::byte> bytes) {
  return bytes.size() >= kHeaderBytes &&
         (bytes.size() - kHeaderBytes) / kFacetBytes >= facets_of(bytes) &&
         ((bytes.size() - kHeaderBytes) == kFacetBytes * u64(facets_of(bytes)) ||
          !as_text(bytes).starts_with("solid"));
}

MeshData read_binary(Builder& builder) {
  const auto bytes = builder.bundle.model().bytes;
  const u32 count = facets_of(bytes);
  Budget::check(count, builder.options.limits.triangles, "triangles", "facets");
  builder.budget.take(count, sizeof(uvec3) + 3 * sizeof(vec3), "facets");
  Welder welder;
  for (u32 i = 0; i < count; ++i) {
    std::array<vec3, 3> corners;
    std::memcpy(corners.data(), bytes.data() + kHeaderBytes + kFacetBytes * u64(i) + 12,
                sizeof corners);
    const std::string where = fmt::format("facet {}", i);
    const u32 a = welder.vertex(corners[0], where);
    const u32 b = welder.vertex(corners[1], where);
    welder.mesh.triangles.emplace_back(a, b, welder.vertex(corners[2], where));
  }
  return std::move(welder.mesh);
}

MeshData read_ascii(Builder& builder) {
  Welder welder;
  std::vector<u32> corners;
  Lines lines(as_text(builder.bundle.model().bytes));
  while (auto line = lines.next()) {
    std::string_view rest = *line;
    const std::string_view key = take_word(rest);
    if (key == "vertex") {
      const float x = take_number(rest, lines.where());
      const float y = take_number(rest, lines.where());
      corners.push_back(welder.vertex({x, y, take_number(rest, lines.where())}, lines.where()));
    } else if (key == "endloop" || key == "outer") {
      if (key == "endloop" && corners.size() != 3) {
        refuse(lines.where(), fmt::format("a facet has {} vertices, not 3", corners.size()));
      }
      if (corners.size() == 3)
        welder.mesh.triangles.emplace_back(corners[0], corners[1], corners[2]);
      corners.clear();
      Budget::check(welder.mesh.triangles.size(), builder.options.limits.triangles, "triangles",
                    lines.where());
    }
  }
  if (!corners.empty()) refuse(lines.where(), "the file is truncated");
  return std::move(welder.mesh);
}

}  // namespace

void load_stl(Builder& builder) {
  const auto bytes = builder.bundle.model().bytes;
  const bool binary = is_binary(bytes);
  if (!binary && !trimmed(as_text(bytes)).starts_with("solid")) {
    refuse("facets", "is neither binary STL of its size nor ASCII STL; the file may be truncated");
  }
  MeshData mesh = binary ? read_binary(builder) : read_ascii(builder);
  to_world_axes(mesh, builder.options);
  const std::string stem = stem_of(builder.bundle.model().path);
  PutEntity root;
  root.mesh = builder.library(builder.claim_name(stem, "mesh"),
                              finish_mesh(std::move(mesh), "facets", builder.budget));
  builder.entity("", std::move(root));
}

}  // namespace heliograph::assets
