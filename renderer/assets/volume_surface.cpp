#include "renderer/assets/volume_surface.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/SignedFloodFill.h>
#include <openvdb/tools/VolumeToMesh.h>

#include <cmath>

#include "renderer/scene/invertible.h"

namespace heliograph::assets {
namespace {

namespace vdb = openvdb;
using Leaf = vdb::FloatTree::LeafNodeType;

/// The leaves as a grid in index space, whatever their file was.
vdb::FloatGrid::Ptr distances(const Bricks& bricks, const Bricks::Read& read,
                              const std::string& name) {
  const float band = bricks.look().background > 0 ? bricks.look().background : 1;
  auto grid = vdb::FloatGrid::create(band);
  bricks.each_leaf(read, [&](ivec3 origin, std::span<const float> values) {
    auto leaf = std::make_unique<Leaf>(vdb::Coord(origin.x, origin.y, origin.z), band);
    for (u32 i = 0; i < kBrickVoxels; ++i) {
      const float value = values[i];
      if (!std::isfinite(value)) refuse(name, "holds a number that is NaN or infinite");
      if (std::abs(value) < band)
        leaf->setValueOn(i, value);
      else
        leaf->setValueOff(i, std::copysign(band, value));
    }
    grid->tree().addLeaf(leaf.release());
  });
  constexpr bool kThreaded = false;
  vdb::tools::signedFloodFill(grid->tree(), kThreaded);  // the inside has no leaves
  return grid;
}

class Gradient {
 public:
  explicit Gradient(const vdb::FloatGrid& grid) : accessor_(grid.getConstAccessor()) {}

  vec3 operator()(const vdb::Vec3s& at) const {
    constexpr double kStep = 0.5;  // voxels
    vec3 out;
    for (int i = 0; i < 3; ++i) {
      vdb::Vec3d low(at), high(at);
      low[i] -= kStep, high[i] += kStep;
      out[i] = vdb::tools::BoxSampler::sample(accessor_, high) -
               vdb::tools::BoxSampler::sample(accessor_, low);
    }
    return out;
  }

 private:
  vdb::FloatGrid::ConstAccessor accessor_;
};

}  // namespace

void add_surface(const Bricks& bricks, const Bricks::Read& read, const std::string& name,
                 Model& model, Budget& budget) {
  const mat4x3& placed = bricks.look().object_from_index;
  if (!invertible(placed)) refuse(name, "has a transform that is not invertible");
  const vdb::FloatGrid::Ptr grid = distances(bricks, read, name);
  std::vector<vdb::Vec3s> points;
  std::vector<vdb::Vec3I> triangles;
  std::vector<vdb::Vec4I> quads;
  vdb::tools::volumeToMesh(*grid, points, triangles, quads);
  if (points.empty()) refuse(name, "has no surface: its values are all above 0, or all below");
  MeshData& mesh = model.mesh;
  budget.take(points.size(), sizeof(glm::dvec3) + sizeof(vec3), name);
  budget.take(triangles.size() + 2 * quads.size(), sizeof(uvec3) + sizeof(u32), name);
  const u32 first = u32(model.positions.size());
  const glm::dmat4x3 to_file(placed);
  const mat3 turned = glm::transpose(glm::inverse(mat3(placed)));
  const Gradient gradient(*grid);
  for (const vdb::Vec3s& p : points) {
    model.positions.push_back(to_file * glm::dvec4(p[0], p[1], p[2], 1));
    mesh.normals.push_back(unit(turned * gradient(p)));
  }
  const bool is_mirrored = glm::determinant(mat3(placed)) < 0;
  const auto add = [&](u32 a, u32 b, u32 c) {
    if (is_mirrored) std::swap(b, c);
    mesh.triangles.emplace_back(first + a, first + b, first + c);
    mesh.parts.push_back(u32(mesh.part_names.size()));
  };
  for (const vdb::Vec3I& t : triangles) add(t[0], t[1], t[2]);
  for (const vdb::Vec4I& q : quads) add(q[0], q[1], q[2]), add(q[0], q[2], q[3]);
  mesh.part_names.push_back(name);
}

}  // namespace heliograph::assets
