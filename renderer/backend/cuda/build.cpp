// Memory and order of the programs of build.cu.
#include "renderer/backend/cuda/build.h"

#include <fmt/format.h>

#include <algorithm>

#include "renderer/backend/cuda/layout.h"

namespace heliograph::cuda {
namespace {

// To enter an instance costs the ray's way into its space and the first node there.
constexpr float kInstanceCost = 2, kTriangleCost = 0.3f;

struct TopArrays {
  kernels::BvhInstance* items;
  u32* item_of_instance;
  // Where there is a tree:
  kernels::BvhNode* nodes = nullptr;
  u32* parents = nullptr;
  kernels::TreeHead* tree = nullptr;
};
TopArrays lay_result(Layout& layout, const BuildInput& input) {
  TopArrays made{layout.take<kernels::BvhInstance>(input.count), layout.take<u32>(input.count)};
  if (!input.has_tree()) return made;
  made.nodes = layout.take<kernels::BvhNode>(input.count);
  made.parents = layout.take<u32>(input.count);
  made.tree = layout.take<kernels::TreeHead>(1);
  return made;
}

struct MeshArrays {
  kernels::BvhNode* nodes;
  u32* parents;
  kernels::TreeHead* tree;
  kernels::BvhTriangle* triangles = nullptr;
  u32* numbers = nullptr;  // where there are no triangles
};
MeshArrays lay_mesh(Layout& layout, const kernels::MeshView& mesh) {
  const u32 count = mesh.triangle_count;
  MeshArrays made{layout.take<kernels::BvhNode>(count), layout.take<u32>(count),
                  layout.take<kernels::TreeHead>(1)};
  if (kernels::has_packed_triangles(mesh))
    made.triangles = layout.take<kernels::BvhTriangle>(count);
  else
    made.numbers = layout.take<u32>(count);
  return made;
}

/// True if one block sorts all keys.
bool is_few(const BuildLaunch& launch) { return launch.sort_blocks == 1; }

/// Lays out what a build works on besides its input and its result.
void lay_work(Layout& layout, u64 mesh_boxes, BuildLaunch& launch) {
  kernels::BuildView& tree = launch.tree;
  const u64 count = tree.count;
  for (u64*& keys : launch.keys) keys = layout.take<u64>(count);
  for (u32*& order : launch.order) order = layout.take<u32>(count);
  launch.boxes = layout.take<kernels::BvhBox>(count);
  tree.boxes = launch.boxes;
  tree.keys = launch.keys[0];
  tree.order = launch.order[0];
  // These begin as bytes of 0xff.
  tree.head = layout.take<kernels::BuildHead>(1);
  if (!is_few(launch)) {
    launch.counts = layout.take<SortCounts>(1);
    launch.sums = layout.take<u32>(u64(launch.sort_blocks) * kSortPasses * kSortDigits);
  }
  if (launch.before.nodes) {
    launch.before.head = layout.take<RefitHead>(1);
    launch.before.done = layout.take<u32>(count);
  }
  launch.begin_bytes = layout.end() - DevicePointer(tree.head);
  tree.nodes = layout.take<kernels::BuildNode>(2 * count);
  tree.clusters = layout.take<kernels::BuildCluster>(count);
  tree.ends = layout.take<u32>(2 * count);
  tree.tasks = layout.take<kernels::BuildTask>(count);
  tree.items = layout.take<u32>(count);
  launch.mesh_boxes = layout.take<kernels::BvhBox>(mesh_boxes);
  if (!launch.before.nodes) return;
  launch.before.boxes = layout.take<kernels::BvhBox>(count);
  launch.before.refitted = layout.take<kernels::RefitNode>(count);
}

/// The tree that was there.
Refit refit_of(const BuildInput& input) {
  if (!input.before) return {};
  Layout layout(input.before->at());
  const TopArrays made = lay_result(layout, input);
  return {.nodes = made.nodes, .items = made.items, .parents = made.parents, .tree = made.tree};
}
Refit refit_of(const MeshBefore& before) {
  if (!before.tree) return {};
  Layout layout(before.tree->at());
  const MeshArrays made = lay_mesh(layout, before.mesh);
  return {.nodes = made.nodes,
          .triangles = made.triangles,
          .triangle_numbers = made.numbers,
          .parents = made.parents,
          .tree = made.tree};
}

LaunchSize blocks_of(u64 threads, u32 block) { return {u32((threads + block - 1) / block), block}; }

}  // namespace

kernels::BvhView view_of_top(const DeviceMemory& top, const BuildInput& input) {
  Layout layout(top.at());
  const TopArrays made = lay_result(layout, input);
  return {made.nodes, made.items, input.meshes, made.item_of_instance, input.count, {}};
}

kernels::MeshBvh view_of_mesh(const DeviceMemory& tree, const kernels::MeshView& mesh) {
  Layout layout(tree.at());
  const MeshArrays made = lay_mesh(layout, mesh);
  return {made.nodes, made.triangles, made.numbers};
}

Expected<TreeBuilder> TreeBuilder::create(std::shared_ptr<Context> context) {
  TreeBuilder builder(std::move(context));
  for (const auto& [name, program] :
       {std::pair{"build_boxes", &builder.boxes_},
        std::pair{"build_triangle_boxes", &builder.triangle_boxes_},
        std::pair{"build_triangles", &builder.triangles_}, std::pair{"build_keys", &builder.keys_},
        std::pair{"build_leaves", &builder.leaves_},
        std::pair{"build_clusters", &builder.clusters_}, std::pair{"build_nodes", &builder.nodes_},
        std::pair{"build_items", &builder.items_}, std::pair{"refit_items", &builder.refit_items_},
        std::pair{"refit_triangles", &builder.refit_triangles_},
        std::pair{"refit_nodes", &builder.refit_nodes_}, std::pair{"sort_pass", &builder.pass_},
        std::pair{"sort_few", &builder.few_}}) {
    const auto function = builder.context_->function(name);
    if (!function) return std::unexpected(function.error());
    *program = *function;
  }
  builder.node_blocks_ = builder.context_->processors() *
                         builder.context_->resident_blocks(builder.nodes_, kBuildThreads);
  return builder;
}

Status TreeBuilder::launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch) const {
  void* arguments[] = {&launch};
  return context_->launch(program, size, arguments);
}
Status TreeBuilder::launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch,
                           u32 argument) const {
  void* arguments[] = {&launch, &argument};
  return context_->launch(program, size, arguments);
}

/// Keys of boxes in their order, and the leaves.
Status TreeBuilder::sort(BuildLaunch& l) const {
  if (is_few(l)) return launch(few_, {1, kSortThreads}, l);
  const LaunchSize blocks{l.sort_blocks, kSortThreads};
  HELIO_TRY(launch(keys_, blocks, l));
  for (u32 pass = 0; pass < kSortPasses; ++pass) HELIO_TRY(launch(pass_, blocks, l, pass));
  return launch(leaves_, blocks_of(l.tree.count, kBuildThreads), l);
}

Status TreeBuilder::run(const Kind& kind, BuildLaunch& l) const {
  const LaunchSize all = blocks_of(l.tree.count, kBuildThreads);
  l.tree.item_cost = kind.item_cost;
  HELIO_TRY(context_->fill(DevicePointer(l.tree.head), 0xff, l.begin_bytes));
  if (l.before.nodes) HELIO_TRY(launch(kind.refit, all, l));
  if (l.before.nodes) HELIO_TRY(launch(refit_nodes_, all, l));
  HELIO_TRY(launch(kind.boxes, all, l));
  HELIO_TRY(sort(l));
  for (const u32 again : {0u, 1u}) HELIO_TRY(launch(clusters_, all, l, again));
  HELIO_TRY(launch(nodes_, {std::min(all.blocks, node_blocks_), kBuildThreads}, l));
  return launch(kind.items, all, l);
}

Expected<DeviceMemory> TreeBuilder::work(u64 count, u64 mesh_boxes, BuildLaunch& l) const {
  if (count > kernels::kMostBuildBoxes)
    return fail(Code::kResourceExhausted, "",
                fmt::format("a GPU's tree is over at most {} instances or triangles",
                            kernels::kMostBuildBoxes));
  l.tree.count = u32(count);
  l.sort_blocks = (l.tree.count + kSortKeys - 1) / kSortKeys;
  Layout size(0);
  lay_work(size, mesh_boxes, l);
  auto memory = context_->allocate(size.bytes());
  if (!memory) return memory;
  Layout layout(memory->at());
  lay_work(layout, mesh_boxes, l);
  return memory;
}

Expected<std::shared_ptr<const DeviceMemory>> TreeBuilder::build(const BuildInput& input) const {
  BuildLaunch l{};
  l.instances = input.instances;
  l.motion_keys = input.motion_keys;
  l.meshes = input.meshes;
  l.left_out = input.left_out;
  Layout size(0);
  (void)lay_result(size, input);
  auto made = context_->allocate(size.bytes());
  if (!made) return std::unexpected(std::move(made).error());
  Layout layout(made->at());
  const TopArrays result = lay_result(layout, input);
  l.items = result.items;
  l.item_of_instance = result.item_of_instance;
  if (!input.has_tree()) {
    l.tree.count = input.count;
    HELIO_TRY(launch(items_, blocks_of(input.count, kBuildThreads), l));
    return std::make_shared<const DeviceMemory>(*std::move(made));
  }
  l.before = refit_of(input);
  const auto worked = work(input.count, input.mesh_boxes.size(), l);  // freed when it has run
  if (!worked) return std::unexpected(worked.error());
  l.tree.wide = result.nodes;
  l.tree.tree = result.tree;
  l.tree.parents = result.parents;
  HELIO_TRY(context_->upload(DevicePointer(l.mesh_boxes), std::as_bytes(input.mesh_boxes)));
  HELIO_TRY(run({boxes_, items_, refit_items_, kInstanceCost}, l));
  return std::make_shared<const DeviceMemory>(*std::move(made));
}

Expected<std::shared_ptr<const DeviceMemory>> TreeBuilder::build(const kernels::MeshView& mesh,
                                                                 const MeshBefore& before) const {
  BuildLaunch l{};
  l.mesh = mesh;
  l.before = refit_of(before);
  const auto worked = work(mesh.triangle_count, 0, l);
  if (!worked) return std::unexpected(worked.error());
  Layout size(0);
  (void)lay_mesh(size, mesh);
  auto made = context_->allocate(size.bytes());
  if (!made) return std::unexpected(std::move(made).error());
  Layout layout(made->at());
  const MeshArrays result = lay_mesh(layout, mesh);
  l.tree.wide = result.nodes;
  l.tree.tree = result.tree;
  l.tree.parents = result.parents;
  l.triangles = result.triangles;
  l.triangle_numbers = result.numbers;
  HELIO_TRY(run({triangle_boxes_, triangles_, refit_triangles_, kTriangleCost}, l));
  return std::make_shared<const DeviceMemory>(*std::move(made));
}

}  // namespace heliograph::cuda
