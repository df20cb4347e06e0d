#include "renderer/assets/polygon.h"

#include <algorithm>
#include <cmath>

namespace heliograph::assets {
namespace {

using Point = glm::dvec2;

double turn(Point a, Point b, Point c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/// A polygon in its own plane, counter-clockwise.
std::vector<Point> flatten(std::span<const glm::dvec3> polygon) {
  const glm::dvec3 n = normal_of(polygon);
  const glm::dvec3 size = glm::abs(n);
  const int drop = size.x > size.y && size.x > size.z ? 0 : size.y > size.z ? 1 : 2;
  const int a = (drop + 1) % 3;
  const int b = (drop + 2) % 3;
  std::vector<Point> flat;
  flat.reserve(polygon.size());
  for (const glm::dvec3& p : polygon) {
    flat.emplace_back(n[drop] < 0 ? p[b] : p[a], n[drop] < 0 ? p[a] : p[b]);
  }
  return flat;
}

/// True if no corner turns clockwise and it goes round once: a fan of it covers it.
bool is_convex(const std::vector<Point>& flat) {
  const std::size_t count = flat.size();
  u32 descents = 0;  // of x, as a cycle
  for (std::size_t i = 0; i < count; ++i) {
    const Point a = flat[i], b = flat[(i + 1) % count], c = flat[(i + 2) % count];
    if (turn(a, b, c) < 0) return false;
    descents += (b.x > a.x) != (c.x > b.x);
  }
  return descents <= 2;
}

/// Corners that an ear may not hold, those that are not convex, by cells of a grid.
class Grid {
 public:
  Grid() = default;
  Grid(const std::vector<Point>& points, const std::vector<u32>& members) {
    low_ = high_ = points.front();
    for (const Point& p : points) low_ = glm::min(low_, p), high_ = glm::max(high_, p);
    side_ = std::max<u32>(1, u32(std::sqrt(double(members.size()))));
    cells_.resize(std::size_t(side_) * side_);
    for (const u32 i : members)
      cells_[cell(points[i].x, 0) + side_ * cell(points[i].y, 1)].push_back(i);
  }

  /// True if any corner whose cell meets the box is one that `holds`. Corners for which `gone` is
  /// true are dropped.
  template <class Gone, class Holds>
  bool any(Point low, Point high, const Gone& gone, const Holds& holds) {
    for (u32 y = cell(low.y, 1); y <= cell(high.y, 1); ++y) {
      for (u32 x = cell(low.x, 0); x <= cell(high.x, 0); ++x) {
        std::vector<u32>& members = cells_[x + side_ * y];
        std::erase_if(members, gone);
        if (std::ranges::any_of(members, holds)) return true;
      }
    }
    return false;
  }

 private:
  [[nodiscard]] u32 cell(double at, int axis) const {
    const double size = high_[axis] - low_[axis];
    const double share = size > 0 ? (at - low_[axis]) / size : 0;
    return std::min(side_ - 1, u32(std::clamp(share, 0.0, 1.0) * side_));
  }
  Point low_{0}, high_{0};
  u32 side_ = 1;
  std::vector<std::vector<u32>> cells_;
};

class Clipper {
 public:
  Clipper(const std::vector<Point>& points, std::vector<uvec3>& triangles)
      : points_(points), triangles_(triangles), left_(u32(points.size())) {
    for (u32 i = 0; i < left_; ++i) {
      before_.push_back((i + left_ - 1) % left_);
      after_.push_back((i + 1) % left_);
    }
    std::vector<u32> members;
    for (u32 i = 0; i < left_; ++i)
      if (!is_convex(i)) members.push_back(i);
    grid_ = Grid(points_, members);
  }

  /// Round after round, each cutting what ears it finds, but no two neighbours: so triangles keep a
  /// good shape. A round without an ear means that the outline crosses or touches itself there;
  /// the next ones are less strict.
  void clip() {
    u32 at = 0, since = 0;
    while (left_ > 3) {
      if (is_ear(at)) {
        at = after_[cut(at)], since = 0;
      } else {
        at = after_[at];
        if (++since >= left_) ++leniency_, since = 0;
      }
    }
    triangles_.emplace_back(before_[at], at, after_[at]);
  }

 private:
  [[nodiscard]] double turn_at(u32 i) const {
    return turn(points_[before_[i]], points_[i], points_[after_[i]]);
  }
  [[nodiscard]] bool is_convex(u32 i) const { return turn_at(i) > 0; }
  [[nodiscard]] bool is_gone(u32 i) const { return after_[i] == i; }

  bool is_ear(u32 i) {
    if (leniency_ >= 3) return true;
    if (!is_convex(i)) return false;
    if (leniency_ == 2) return true;
    const Point a = points_[before_[i]], b = points_[i], c = points_[after_[i]];
    const auto holds = [&](u32 k) {
      const Point p = points_[k];
      if (p == a || p == b || p == c) return false;  // its own corner, or a bridge's other one
      const double least = std::min({turn(a, b, p), turn(b, c, p), turn(c, a, p)});
      return leniency_ == 0 ? least >= 0 : least > 0;
    };
    const auto gone = [&](u32 k) { return is_gone(k) || is_convex(k); };
    return !grid_.any(glm::min(glm::min(a, b), c), glm::max(glm::max(a, b), c), gone, holds);
  }

  /// Returns the corner after it.
  u32 cut(u32 i) {
    const u32 before = before_[i], after = after_[i];
    triangles_.emplace_back(before, i, after);
    after_[before] = after;
    before_[after] = before;
    after_[i] = i;
    --left_;
    return after;
  }

  const std::vector<Point>& points_;
  std::vector<uvec3>& triangles_;
  std::vector<u32> before_, after_;  // a ring of what is left
  u32 left_;
  u32 leniency_ = 0;
  Grid grid_;
};

}  // namespace

glm::dvec3 normal_of(std::span<const glm::dvec3> polygon) {
  glm::dvec3 sum(0);
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    sum += glm::cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0]);
  }
  return sum;
}

void triangulate(std::span<const glm::dvec3> polygon, std::vector<uvec3>& triangles) {
  const auto count = u32(polygon.size());
  triangles.clear();
  if (count == 3) triangles.emplace_back(0, 1, 2);
  if (count <= 3) return;
  const std::vector<Point> flat = flatten(polygon);
  if (!is_convex(flat)) return Clipper(flat, triangles).clip();
  for (u32 i = 1; i + 1 < count; ++i) triangles.emplace_back(0, i, i + 1);
}

}  // namespace heliograph::assets
