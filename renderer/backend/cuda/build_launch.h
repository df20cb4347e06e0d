// Arguments of the programs that build trees. Read by build.cu.
#pragma once

#include "kernels/bvh/bvh_cluster.h"
#include "kernels/bvh/bvh_refit.h"

namespace heliograph::cuda {

using kernels::u32;
using kernels::u64;

inline constexpr u32 kBuildThreads = 128;  // of a block
inline constexpr u32 kSortThreads = 256;
inline constexpr u32 kSortKeys = 2048;  // that one block sorts
inline constexpr u32 kSortBits = 8;     // of a pass
inline constexpr u32 kSortDigits = 1u << kSortBits;
inline constexpr u32 kSortPasses = 64 / kSortBits;
static_assert(kSortPasses % 2 == 0, "what is sorted ends where it began");
static_assert(kSortThreads == kSortDigits, "a thread counts the keys of a digit");

/// Counters of a sort by several blocks. They begin as bytes of 0xff: one before 0.
struct SortCounts {
  u32 digits[kSortPasses][kSortDigits];  // keys that have them
  u32 blocks[kSortPasses];               // that have begun a pass
};

/// Results of a refit. Begins as bytes of 0xff.
struct RefitHead {
  u32 fits;    // 0: other items are in the tree than before
  u32 builds;  // 0: the refitted tree is good, and none is built
};

/// A tree that was there, and what refits it. Everything lies in device memory.
struct Refit {
  const kernels::BvhNode* nodes;  // null: there was none
  // Its items, of one kind; the numbers are of triangles.
  const kernels::BvhInstance* items;
  const kernels::BvhTriangle* triangles;
  const u32* triangle_numbers;
  const u32* parents;
  const kernels::TreeHead* tree;
  RefitHead* head;
  u32* done;                     // by node: children that are, from 0xffffffff on
  kernels::BvhBox* boxes;        // of items
  kernels::RefitNode* refitted;  // by node
};

/// A tree over instances, or over the triangles of a mesh. Everything lies in device memory.
struct BuildLaunch {
  kernels::BuildView tree;  // its keys and order are the first of these
  u64* keys[2];
  u32* order[2];
  SortCounts* counts;
  u32* sums;  // of each pass, of each block, by digit: keys of it, later with all blocks before it
  u32 sort_blocks;
  u64 begin_bytes;  // from the tree's head on, that begin as 0xff
  kernels::BvhBox* boxes;
  // of instances
  const kernels::InstanceView* instances;
  const kernels::MotionKey* motion_keys;
  const kernels::MeshBvh* meshes;
  const kernels::BvhBox* mesh_boxes;
  const u32* left_out;          // a bit for each; or null
  kernels::BvhInstance* items;  // the result, with the tree's nodes
  u32* item_of_instance;
  Refit before;
  // of triangles
  kernels::MeshView mesh;
  kernels::BvhTriangle* triangles;  // the result; null: not has_packed_triangles()
  u32* triangle_numbers;            // then this is
};

}  // namespace heliograph::cuda
