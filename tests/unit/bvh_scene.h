// Random scenes of everything that rays meet, resident with both accelerators. Shared by the tests
// of the BVH.
#pragma once

#include "kernels/bvh/bvh_tracer.h"
#include "kernels/core/warp.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/host/ray_packet.h"
#include "renderer/scene/strands.h"
#include "tests/unit/random.h"
#include "tests/unit/render_scene.h"

namespace heliograph::test {

using kernels::kNone;

inline vec3 random_vec3(Random& random, float reach) {
  const vec2 xy = random.next2();
  return (vec3(xy, random.next()) * 2.0f - 1.0f) * reach;
}
inline u32 random_below(Random& random, u32 count) {
  return std::min(count - 1, u32(random.next() * float(count)));
}
inline vec3 random_direction(Random& random) { return kernels::sample_sphere(random.next2()); }

/// Turned, scaled unevenly and sometimes mirrored.
inline mat4x3 random_pose(Random& random, float reach, float size) {
  const vec3 axis = random_direction(random);
  const float angle = random.next() * 6;
  const quat turn = glm::angleAxis(angle, axis);
  vec3 scale = (random_vec3(random, 0.5f) + 1.0f) * size;
  if (random.next() < 0.2f) scale.x = -scale.x;
  const mat3 linear = glm::mat3_cast(turn) * mat3(scale.x, 0, 0, 0, scale.y, 0, 0, 0, scale.z);
  return {linear[0], linear[1], linear[2], random_vec3(random, reach)};
}

/// A sphere whose one morph target moves every vertex by up to `reach`.
inline PutMesh morphing_sphere(Random& random, float reach) {
  Shape shape = sphere(6);
  auto topology = std::make_shared<MeshTopology>();
  topology->vertex_count = u32(shape.positions.size());
  topology->triangles = ArrayOf(std::move(shape.triangles));
  topology->morph_count = 1;
  std::vector<vec3> moves(topology->vertex_count);
  for (vec3& move : moves) move = random_vec3(random, reach);
  topology->morph_positions = ArrayOf(std::move(moves));
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf(std::move(shape.positions));
  return {topology, vertices};
}

/// Triangles with random corners.
inline Shape soup(Random& random, u32 triangles, float reach, float size) {
  Shape shape;
  for (u32 i = 0; i < triangles; ++i) {
    const vec3 at = random_vec3(random, reach);
    for (int k = 0; k < 3; ++k) {
      shape.positions.push_back(at + random_vec3(random, size));
      shape.uvs.push_back(random.next2());
    }
    shape.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return shape;
}

/// Strands about the origin, some of whose segments hold others, with one morph target.
inline PutMesh morphing_strands(Random& random, u32 strands, float reach) {
  auto topology = std::make_shared<MeshTopology>();
  std::vector<vec3> positions;
  std::vector<float> radii;
  std::vector<u32> curves;
  for (u32 i = 0; i < strands; ++i) {
    curves.push_back(2 + random_below(random, 6));
    vec3 at = random_vec3(random, reach);
    for (u32 k = 0; k < curves.back(); ++k) {
      positions.push_back(at);
      radii.push_back(0.01f + 0.2f * random.next() * random.next());
      at += random_vec3(random, 0.5f * reach);
    }
  }
  topology->vertex_count = u32(positions.size());
  topology->curves = ArrayOf(std::move(curves));
  topology->morph_count = 1;
  std::vector<vec3> moves(topology->vertex_count);
  for (vec3& move : moves) move = random_vec3(random, 0.3f);
  topology->morph_positions = ArrayOf(std::move(moves));
  topology->triangles = ArrayOf(segments_of(topology->curves.span()));
  topology->radii = ArrayOf(std::move(radii));
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf(std::move(positions));
  return {topology, vertices};
}

/// Which kinds of entities a scene has; `count` of each.
struct SceneKinds {
  u32 count = 40;
  bool moving = true, deforming = true, shapes = true, holes = true, masks = true;
  bool fixed = false;  // what stands still is static, but for every third
  bool curves = false;
};

/// Strands that stand still, that move, and that deform, as the kinds say.
inline void add_strands(Edits& edits, Random& random, const SceneKinds& kinds, u32 i) {
  const mat4x3 pose = random_pose(random, 8, 0.8f);
  const std::string name = fmt::format("strands {}", i);
  edits.object(name, "strands", pose, kinds.holes && i % 5 == 0 ? "paper" : "");
  PutEntity changes;
  if (kinds.deforming && i % 2) changes.morph_weights = MorphWeights{{0, 1}, {0, 1}};
  if (kinds.moving && i % 3) {
    mat4x3 next = pose;
    next[3] += random_vec3(random, 1);
    changes.pose = PosePatch{{0, 1}, {pose, next}};
  }
  edits.put(name, changes);
}

/// Random entities within about 10 m of the origin, which move during the first second.
inline std::shared_ptr<const Snapshot> random_scene(Random& random, const SceneKinds& kinds) {
  Edits edits;
  edits.mesh("cube", cube()).mesh("sphere", sphere(10)).mesh("quad", quad());
  edits.mesh("soup", soup(random, 60, 1, 0.4f)).put("flesh", morphing_sphere(random, 0.4f));
  const char* meshes[] = {"cube", "sphere", "quad", "soup"};
  PutMaterial paper;
  paper.parameters[std::size_t(MaterialParameter::alpha)].value = vec3(0.4f);
  paper.alpha_mode = AlphaMode::kBlend;
  edits.put("paper", paper);
  if (kinds.curves) edits.put("strands", morphing_strands(random, 12, 1));
  const auto pose = [&] { return random_pose(random, 8, 0.8f); };
  PutEntity fixed;
  fixed.is_static = true;
  for (u32 i = 0; i < kinds.count; ++i) {
    const auto name = [i](const char* kind) { return fmt::format("{} {}", kind, i); };
    const char* mesh = meshes[i % 4];
    edits.object(name("still"), mesh, pose(), kinds.holes && i % 5 == 0 ? "paper" : "");
    if (kinds.masks) {
      PutEntity hidden;
      hidden.visibility = u8(u32(random.next() * 64) & kernels::kAllRays);
      edits.object(name("masked"), mesh, pose()).put(name("masked"), hidden);
    }
    if (kinds.fixed && i % 3 != 0) {
      edits.put(name("still"), fixed);
      if (kinds.masks) edits.put(name("masked"), fixed);
    }
    if (kinds.moving) {
      PutEntity moves;
      mat4x3 next = pose();
      next[3] *= 0.5f;
      moves.pose = PosePatch{{0, 0.4, 1}, {pose(), next, next}};
      moves.pose->matrices[0] = next;
      moves.pose->matrices[1] =
          mat4x3(glm::translate(glm::mat4(1), random_vec3(random, 1)) *
                 glm::rotate(glm::mat4(1), 1.5f, random_direction(random)) * glm::mat4(next));
      edits.object(name("moving"), mesh, next).put(name("moving"), moves);
    }
    if (kinds.deforming) {
      PutEntity deforms;
      deforms.morph_weights = MorphWeights{{0, 1}, {0, 0.2f + random.next()}};
      edits.object(name("flesh"), "flesh", pose()).put(name("flesh"), deforms);
    }
    if (kinds.curves) add_strands(edits, random, kinds, i);
    if (kinds.shapes) {
      Light light;
      light.shape = i % 2 ? LightShape::kSphere : LightShape::kDisc;
      light.radius = 0.2f + random.next();
      edits.pose(name("lamp"), pose()).light(name("lamp"), light);
    }
  }
  return edits.apply();
}

/// A snapshot over a span of time with both accelerators.
class BothScenes {
 public:
  /// static_triangles   of the static groups
  BothScenes(const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
             u64 static_triangles = 0)
      : embree_accelerator_(device_.get(), static_triangles), own_accelerator_(static_triangles) {
    auto embree = embree_store_.prepare(snapshot, span, Interrupt{});
    auto own = own_store_.prepare(snapshot, span, Interrupt{});
    REQUIRE((embree && own));
    embree_ = *embree;
    own_ = *own;
    traced_ = embree::traced(*embree_);
    bvh_ = bvh::world_view(own_->placement());
  }
  [[nodiscard]] embree::EmbreeTracer embree(const embree::SecondLook& look = {}) const {
    return embree::EmbreeTracer(traced_, look);
  }
  [[nodiscard]] kernels::BvhTracer bvh() const { return {own_->view(), bvh_}; }
  [[nodiscard]] const kernels::SceneView& view() const { return own_->view(); }
  [[nodiscard]] const kernels::BvhView& bvh_view() const { return bvh_; }
  [[nodiscard]] const resident::ResidentScene& own() const { return *own_; }
  [[nodiscard]] const resident::ResidentScene& other() const { return *embree_; }

 private:
  embree::DeviceHandle device_{rtcNewDevice(nullptr)};
  resident::DerivedCache embree_cache_{1u << 30}, own_cache_{1u << 30};
  embree::EmbreeAccelerator embree_accelerator_;
  bvh::BvhAccelerator own_accelerator_;
  resident::SceneStore embree_store_{embree_accelerator_, embree_cache_, 1u << 30};
  resident::SceneStore own_store_{own_accelerator_, own_cache_, 1u << 30};
  std::shared_ptr<const resident::ResidentScene> embree_, own_;
  embree::TracedScene traced_;
  kernels::BvhView bvh_;
};

/// From within a cube of 2 `reach`; half of the rays end somewhere.
inline kernels::Ray random_ray(Random& random, float reach) {
  kernels::Ray ray{};
  ray.origin = random_vec3(random, reach);
  ray.direction = random_direction(random);
  ray.t_max = random.next() < 0.5f ? INFINITY : random.next() * reach;
  ray.time = random.next();
  ray.holes = {u32(random.next() * 1e6f), random.next() < 0.3f};
  return ray;
}

inline void set_ray(host::RayPacket& packet, u32 i, const kernels::Ray& ray) {
  packet.origin_x[i] = ray.origin.x;
  packet.origin_y[i] = ray.origin.y;
  packet.origin_z[i] = ray.origin.z;
  packet.direction_x[i] = ray.direction.x;
  packet.direction_y[i] = ray.direction.y;
  packet.direction_z[i] = ray.direction.z;
  packet.t_max[i] = ray.t_max;
}

/// Steps of a walk, all of which look at a node or at items that were put off.
inline u64 steps_of(const kernels::SceneView& scene, const kernels::BvhView& bvh,
                    const kernels::Ray& ray) {
  kernels::BvhStack stack;
  kernels::BvhWalk walk(scene, bvh, stack);
  walk.begin(ray, kernels::kAllRays, false);
  u64 steps = 1;
  while (walk.step()) ++steps;
  return steps;
}

}  // namespace heliograph::test
