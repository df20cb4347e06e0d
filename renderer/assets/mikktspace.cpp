// Source: Mikkelsen 2008, "Simulation of Wrinkled Surfaces Revisited". One difference: all
// triangles at an edge that runs both ways are joined, where the thesis pairs them in their order;
// so the order of triangles does not matter.
#include "renderer/assets/mikktspace.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>

namespace heliograph::assets {
namespace {

constexpr u32 kNone = ~0u;
constexpr u64 kMaxTriangles = ~0u / 3;  // whose corners have numbers of 32 bits

/// Orientation of a triangle in the texture.
enum class Side : i32 {
  kMirrored = -1,
  kEither = 0,  // no area there: it joins groups of both sides, and adds to none
  kUpright = 1,
  kAbsent = 2,  // two corners at one place: it joins nothing
};

struct Face {
  vec3 along;  // unit, growing u
  Side side;
};

Face face_of(const MeshData& mesh, const uvec3& t) {
  const vec3 a = mesh.positions[t.x], b = mesh.positions[t.y], c = mesh.positions[t.z];
  if (a == b || b == c || c == a) return {vec3(0), Side::kAbsent};
  const vec2 ab = mesh.uvs[t.y] - mesh.uvs[t.x], ac = mesh.uvs[t.z] - mesh.uvs[t.x];
  const float area = ab.x * ac.y - ab.y * ac.x;
  const vec3 along_u = unit((b - a) * ac.y - (c - a) * ab.y);
  const vec3 along_v = (c - a) * ab.x - (b - a) * ac.x;
  const bool has_area = std::fabs(area) > std::numeric_limits<float>::min();
  if (!has_area || along_u == vec3(0) || along_v == vec3(0)) return {vec3(0), Side::kEither};
  return area > 0 ? Face{along_u, Side::kUpright} : Face{-along_u, Side::kMirrored};
}

/// Values that corners must share to be of one vertex.
struct Vertex {
  vec3 position, normal;
  vec2 uv;
  bool operator==(const Vertex&) const = default;
};

/// The first of the vertices equal to each. Zeros of both signs are equal.
std::vector<u32> weld(const MeshData& mesh) {
  const auto vertex = [&](u32 v) {
    return Vertex{mesh.positions[v] + 0.0f, mesh.normals[v] + 0.0f, mesh.uvs[v] + 0.0f};
  };
  const auto count = u32(mesh.positions.size());
  std::vector<u32> slots(std::bit_ceil(2 * std::size_t(count)), kNone), first(count);
  for (u32 v = 0; v < count; ++v) {
    const Vertex own = vertex(v);
    std::size_t at = VertexHash{}(own) & (slots.size() - 1);
    while (slots[at] != kNone && vertex(slots[at]) != own) at = (at + 1) & (slots.size() - 1);
    if (slots[at] == kNone) slots[at] = v;
    first[v] = slots[at];
  }
  return first;
}

/// Between two edges in the plane of a normal, [0, pi]; a right angle where one stands upright.
float angle_between(const vec3& a, const vec3& b) {
  const float sine = glm::length(glm::cross(a, b)), cosine = glm::dot(a, b);
  return sine == 0 && cosine == 0 ? std::numbers::pi_v<float> / 2 : std::atan2(sine, cosine);
}

/// Sets of the numbers below a count; find() names a set by one of them.
class Sets {
 public:
  void reset(std::size_t count) {
    parents_.resize(count);
    std::iota(parents_.begin(), parents_.end(), 0u);
  }
  [[nodiscard]] u32 find(u32 i) {
    while (parents_[i] != i) i = parents_[i] = parents_[parents_[i]];
    return i;
  }
  void unite(u32 a, u32 b) { parents_[find(b)] = find(a); }

 private:
  std::vector<u32> parents_;
};

/// Corners are numbered 3 * triangle + 0, 1 or 2.
class Maker {
 public:
  Maker(MeshData& mesh, Budget& budget)
      : mesh_(mesh),
        budget_(budget),
        vertices_(reinterpret_cast<u32*>(mesh.triangles.data()), mesh.triangles.size() * 3) {
    constexpr u64 kOfTriangle = sizeof(Face) + 3 * sizeof(u32);
    constexpr u64 kOfVertex = 6 * sizeof(u32) + sizeof(vec4);  // four: slots of weld()
    Budget::check(mesh.triangles.size(), kMaxTriangles, "triangles with tangents", "tangents");
    budget.take(mesh.triangles.size(), kOfTriangle, "tangents");
    budget.take(mesh.positions.size(), kOfVertex, "tangents");
    welded_ = weld(mesh);
    tangents_.resize(mesh.positions.size(), vec4(0, 0, 0, 1));
    faces_.reserve(mesh.triangles.size());
    for (const uvec3& t : mesh.triangles) faces_.push_back(face_of(mesh, t));
  }

  void make() {
    const std::size_t count = welded_.size();
    std::vector<u32> starts(count + 2), corners(faces_.size() * 3);
    for (u32 c = 0; c < corners.size(); ++c) ++starts[welded(c) + 2];
    std::partial_sum(starts.begin(), starts.end(), starts.begin());
    for (u32 c = 0; c < corners.size(); ++c) corners[starts[welded(c) + 1]++] = c;
    u32 most = 0;
    for (std::size_t v = 0; v < count; ++v) most = std::max(most, starts[v + 1] - starts[v]);
    constexpr u64 kOfCorner = 172;  // of the lists about a vertex, which may grow by doubling
    budget_.take(most, kOfCorner, "tangents");
    for (u32 v = 0; v < count; ++v) {
      look_at(v, std::span(corners).subspan(starts[v], starts[v + 1] - starts[v]));
      group(Side::kUpright);
      group(Side::kMirrored);
      if (!groups_.empty()) assign();
    }
    split();
  }

 private:
  struct Corner {
    u32 number;
    u32 next, last;  // the others of the triangle, welded
    Side side;
  };
  struct Group {
    glm::dvec3 sum;  // doubles: so that the order of triangles does not matter
    Side side;
  };

  /// May be a copy, which has no arrays before split(); what it was copied from is welded with it.
  [[nodiscard]] u32& vertex_of(u32 corner) { return vertices_[corner]; }
  [[nodiscard]] u32 welded(u32 corner) { return welded_[vertex_of(corner)]; }
  [[nodiscard]] static u32 next(u32 corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }

  void look_at(u32 vertex, std::span<const u32> corners) {
    position_ = mesh_.positions[vertex];
    normal_ = unit(mesh_.normals[vertex]);
    groups_.clear();
    group_of_.assign(corners.size(), kNone);
    corners_.clear();
    for (const u32 c : corners) {
      corners_.push_back({c, welded(next(c)), welded(next(next(c))), faces_[c / 3].side});
    }
  }

  /// Adds the groups of one side about a vertex: triangles that are joined at edges.
  void group(Side wanted) {
    const auto count = u32(corners_.size());
    found_.assign(count, kNone);
    if (std::ranges::count(corners_, wanted, &Corner::side) == 0) return;
    join(wanted);
    for (u32 i = 0; i < count; ++i) {
      if (corners_[i].side != wanted) continue;
      u32& found = found_[sets_.find(i)];
      if (found == kNone) {
        found = u32(groups_.size());
        groups_.push_back({glm::dvec3(0), wanted});
      }
      groups_[found].sum += share(corners_[i]);
    }
    for (u32 i = 0; i < count; ++i) {
      if (corners_[i].side == wanted ||
          (corners_[i].side == Side::kEither && group_of_[i] == kNone))
        group_of_[i] = found_[sets_.find(i)];
    }
  }

  /// Unites the corners about a vertex whose triangles share an edge that begins there, which must
  /// run both ways.
  void join(Side wanted) {
    sets_.reset(corners_.size());
    outgoing_.clear();
    incoming_.clear();
    for (u32 i = 0; i < corners_.size(); ++i) {
      if (corners_[i].side != wanted && corners_[i].side != Side::kEither) continue;
      outgoing_.push_back(u64(corners_[i].next) << 32 | i);
      incoming_.push_back(u64(corners_[i].last) << 32 | i);
    }
    constexpr std::size_t kFew = 16;  // are compared with one another, more are sorted
    if (outgoing_.size() <= kFew) {
      for (const u64 out : outgoing_)
        for (const u64 in : incoming_)
          if (out >> 32 == in >> 32) sets_.unite(u32(out), u32(in));
      return;
    }
    std::ranges::sort(outgoing_);
    std::ranges::sort(incoming_);
    unite_with_first(outgoing_, incoming_);
    unite_with_first(incoming_, outgoing_);
  }
  /// Unites each corner with the first of the others at the same edge. Both are sorted.
  void unite_with_first(const std::vector<u64>& corners, const std::vector<u64>& others) {
    auto other = others.begin();
    for (const u64 corner : corners) {
      while (other != others.end() && *other >> 32 < corner >> 32) ++other;
      if (other == others.end()) return;
      if (*other >> 32 == corner >> 32) sets_.unite(u32(corner), u32(*other));
    }
  }

  /// Contribution of a triangle at a corner: its direction in the plane of the normal, by its angle
  /// there.
  [[nodiscard]] glm::dvec3 share(const Corner& corner) const {
    const float angle = angle_between(flattened(mesh_.positions[corner.next] - position_),
                                      flattened(mesh_.positions[corner.last] - position_));
    const vec3 along = flattened(faces_[corner.number / 3].along);
    const float length = glm::length(along);
    return length > 0 ? glm::dvec3(along) * double(angle / length) : glm::dvec3(0);
  }
  [[nodiscard]] vec3 flattened(const vec3& v) const { return v - normal_ * glm::dot(normal_, v); }

  /// Gives corners the tangents of their groups. Those that no group has take those of the first.
  void assign() {
    const auto tangent = [&](u32 group) {
      const auto& [sum, side] = groups_[group];
      return vec4(unit(vec3(sum)), float(side));
    };
    if (groups_.size() == 1) {
      const vec4 common = tangent(0);
      for (const Corner& corner : corners_) tangents_[vertex_of(corner.number)] = common;
      return;
    }
    order_.clear();
    for (u32 i = 0; i < corners_.size(); ++i) {
      const u32 group = group_of_[i] == kNone ? 0 : group_of_[i];
      order_.emplace_back(u64(vertex_of(corners_[i].number)) << 32 | group, corners_[i].number);
    }
    std::ranges::sort(order_);
    u64 last = ~u64(0);
    u32 index = kNone;
    for (const auto& [key, corner] : order_) {
      if (key >> 32 != last >> 32) {
        index = u32(key >> 32);
      } else if (key != last) {
        index = copy_of(u32(key >> 32));
      }
      last = key;
      tangents_[index] = tangent(u32(key));
      vertex_of(corner) = index;
    }
  }

  u32 copy_of(u32 vertex) {
    budget_.take(1, sizeof(vec4) + 2 * sizeof(u32), "tangents");
    copied_.push_back(vertex);
    welded_.push_back(welded_[vertex]);
    tangents_.emplace_back();
    return u32(tangents_.size() - 1);
  }

  void split() {
    for_each_vertex_array(mesh_, [&]<class T>(std::vector<T>& values) {
      if (values.empty()) return;
      budget_.take(copied_.size(), sizeof(T), "tangents");
      values.reserve(values.size() + copied_.size());
      for (const u32 v : copied_) values.push_back(values[v]);
    });
    mesh_.tangents = std::move(tangents_);
  }

  MeshData& mesh_;
  Budget& budget_;
  std::span<u32> vertices_;  // by corner: the mesh's triangles
  std::vector<Face> faces_;
  std::vector<u32> welded_;     // by vertex, copies too: weld()
  std::vector<vec4> tangents_;  // by vertex
  std::vector<u32> copied_;     // vertices, by copy
  // About one vertex:
  std::vector<Corner> corners_;
  vec3 position_{0}, normal_{0};
  std::vector<u32> group_of_;  // by place in corners_
  std::vector<u32> found_;     // group by set
  std::vector<Group> groups_;
  std::vector<u64> outgoing_, incoming_;    // edges: the other end, the place in corners_
  std::vector<std::pair<u64, u32>> order_;  // vertex and group, corner
  Sets sets_;
};

}  // namespace

void add_tangents(MeshData& mesh, Budget& budget) { Maker(mesh, budget).make(); }

}  // namespace heliograph::assets
