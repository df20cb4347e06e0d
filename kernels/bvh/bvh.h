// The two-level compressed 8-wide BVH as plain data: one tree over the instances, one over each
// mesh. Built by renderer/bvh, walked by bvh_tracer.h.
//
// Source: Ylitie, Karras and Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through
// Compressed Wide BVHs", HPG, section 3.
#pragma once

#include "kernels/scene/scene_view.h"

namespace heliograph::kernels {

inline constexpr u32 kBvhChildren = 8;
inline constexpr u32 kBvhLeafItems = 3;  // of one child
/// No tree of the builder is deeper; the walk's stack relies on it.
inline constexpr u32 kBvhDepth = 24;

/// Up to 8 children. A child's box along axis k is origin[k] + 2^(exponent[k] - 127) * [low, high].
///
/// A child that is a node has bit `slot` of `inner` and meta 32 + 24 + slot; its number is
/// first_child + how many lower bits of `inner` are set. One that is a leaf has in meta's upper 3
/// bits a one for each of its items, and in the lower 5 where they start after first_item. An empty
/// slot has meta 0.
struct alignas(16) BvhNode {
  vec3 origin;
  u8 exponent[3];
  u8 inner;
  u32 first_child;
  u32 first_item;
  u8 meta[8];
  u8 low[3][8];  // by axis and slot
  u8 high[3][8];
};

/// A triangle of a mesh that does not deform, object space; or of one in StaticBvh, world space.
struct alignas(16) BvhTriangle {
  vec3 a;
  u32 number;  // in the mesh
  vec3 b;
  u32 visibility;  // ray mask bits; this and the next in StaticBvh alone
  vec3 c;
  u32 member;
};

/// The tree over one mesh. A leaf's items are numbers of `triangles`, or of `triangle_numbers`
/// where the mesh deforms or has curves: then boxes hold at all times and `triangles` is null.
struct MeshBvh {
  const BvhNode* nodes;  // the root is the first; null: a disc or a sphere (shape.h)
  const BvhTriangle* triangles;
  const u32* triangle_numbers;
};

enum BvhInstanceFlag : u32 {
  kBvhMoves = 1,  // its pose is pose_at() at the ray's time
  kBvhShape = 2,  // it shows a disc or a sphere: `nodes` is null
};

/// Data that a ray needs to enter an instance.
struct alignas(16) BvhInstance {
  vec4 object_from_world[3];  // rows; of what does not move
  const BvhNode* nodes;       // of its mesh
  const BvhTriangle* triangles;
  u32 instance;
  u32 mesh;
  u32 visibility;  // ray mask bits
  u32 flags;       // BvhInstanceFlag. Holes depend on materials: InstanceView::flags has them
};

/// One tree over the triangles of static instances, its members: rays of the world meet them
/// without a change of coordinates, and where members overlap, the boxes of their parts do not.
struct StaticBvh {
  const BvhNode* nodes;  // null: there are no members
  const BvhTriangle* triangles;
  const u32* instances;  // by member, ascending
};

/// All that a walk reads besides the SceneView.
struct BvhView {
  const BvhNode* top;        // over items but members of `fixed`; null: none can be met
  const BvhInstance* items;  // of all instances; those that are not in `top` come last
  const MeshBvh* meshes;
  const u32* item_of_instance;
  u32 instance_count;
  StaticBvh fixed;
};

static_assert(sizeof(BvhNode) == 80 && std::is_trivially_copyable_v<BvhNode>);
static_assert(sizeof(BvhTriangle) == 48 && std::is_trivially_copyable_v<BvhTriangle>);
static_assert(sizeof(BvhInstance) == 80 && std::is_trivially_copyable_v<BvhInstance>);
static_assert(std::is_trivially_copyable_v<BvhView>);

}  // namespace heliograph::kernels
