// Views of the host to views of the device: the same, but for where their arrays lie.
#include "renderer/backend/cuda/scene.h"

#include <algorithm>
#include <unordered_map>

#include "kernels/texture.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/scene/grid.h"

namespace heliograph::cuda {

namespace {

/// Trees over more instances than these are built on the device.
constexpr u32 kMostHostInstances = 512;
/// The same of triangles of a mesh that deforms.
constexpr u32 kMostHostTriangles = 512;

}  // namespace

using kernels::GridView;
using kernels::LightView;
using kernels::MeshView;
using kernels::TextureView;

Expected<std::shared_ptr<const CudaScene>> CudaScene::create(
    std::shared_ptr<const ResidentScene> host, Mirror& mirror, const TreeBuilder& builder) {
  std::shared_ptr<CudaScene> scene(new CudaScene(std::move(host), mirror));
  scene->view_ = scene->host_->view();
  scene->copy_meshes();
  scene->copy_materials();
  scene->copy_lights();
  scene->copy_dome();
  scene->copy_volumes();
  scene->copy_bvh(builder);
  HELIO_TRY(scene->copies_.status());
  return scene;
}

void CudaScene::copy_meshes() {
  const Placement& placement = host_->placement();
  meshes_.assign(view_.meshes, view_.meshes + placement.meshes.size());
  for (MeshView& m : meshes_) {
    const u64 triangles = m.triangle_count, vertices = m.vertex_count;
    const u64 keyed = vertices * (m.segments + 1);
    m.triangles = copies_.of(m.triangles, triangles);
    m.positions = copies_.of(m.positions, keyed);
    m.normals = copies_.of(m.normals, keyed);
    m.rest_positions = copies_.of(m.rest_positions, vertices);
    m.uvs = copies_.of(m.uvs, vertices);
    m.uvs1 = copies_.of(m.uvs1, vertices);
    m.colors = copies_.of(m.colors, vertices);
    m.tangents = copies_.of(m.tangents, vertices);
    m.parts = copies_.of(m.parts, triangles);
  }
  view_.meshes = copies_.of_own(std::span<const MeshView>(meshes_));
  view_.instances = copies_.of(view_.instances, view_.instance_count);
  view_.motion_keys = copies_.of(view_.motion_keys, placement.motion_keys.size());
  const auto& part_materials = placement.structure->part_materials;
  view_.part_materials = copies_.of(part_materials.data(), part_materials.size());
}

void CudaScene::copy_materials() {
  const Materials& materials = *host_->pieces().materials;
  std::vector<TextureView> textures = materials.textures;
  for (TextureView& t : textures) {
    if (!t.texels) continue;
    t.texels = copies_.of(static_cast<const std::byte*>(t.texels), kernels::texture_bytes(t));
    t.mips = copies_.of(static_cast<const std::byte*>(t.mips), kernels::mip_bytes(t));
  }
  view_.textures = copies_.of_own(std::span<const TextureView>(textures));
  view_.materials = copies_.of(materials.materials.data(), materials.materials.size());
  view_.texture_uses = copies_.of(materials.uses.data(), materials.uses.size());
}

void CudaScene::copy_lights() {
  const Lights& lights = host_->lights();
  std::unordered_map<const void*, const PartTrees*> trees;  // by their nodes
  for (const auto* all : {&lights.part_trees, &lights.mapped_trees})
    for (const auto& tree : *all)
      if (tree) trees[tree->nodes.data()] = tree.get();
  std::vector<LightView> views = lights.lights;
  for (LightView& light : views) {
    const auto found = trees.find(light.tree.nodes);
    if (found == trees.end()) continue;  // of a shape: it is never looked at
    const PartTrees& tree = *found->second;
    light.tree.nodes = copies_.of(tree.nodes.data(), tree.nodes.size());
    light.tree.entries = copies_.of(tree.entries.data(), tree.entries.size());
    light.tree.entry_of_triangle =
        copies_.of(tree.entry_of_triangle.data(), tree.entry_of_triangle.size());
  }
  view_.lights = copies_.of_own(std::span<const LightView>(views));
  view_.part_lights = copies_.of(lights.part_lights.data(), lights.part_lights.size());
  view_.light_nodes = copies_.of(lights.tree->nodes.data(), lights.tree->nodes.size());
  std::vector<kernels::SunView> suns = lights.suns;
  for (kernels::SunView& sun : suns)
    if (sun.segments > 0) sun.motion_keys = copies_.of(sun.motion_keys, sun.segments + 1);
  view_.suns = copies_.of_own(std::span<const kernels::SunView>(suns));
  view_.casters = copies_.of(view_.casters, view_.caster_count);
  view_.cast_lights = copies_.of(view_.cast_lights, view_.cast_light_count);
  view_.black_body = copies_.of(view_.black_body, kernels::kBlackBodyEntries);
}

void CudaScene::copy_dome() {
  const Lights& lights = host_->lights();
  kernels::DomeView& dome = view_.dome;
  if (const DomeTables* tables = lights.dome_tables.get()) {
    dome.row_cdf = copies_.of(tables->row_cdf.data(), tables->row_cdf.size());
    dome.column_cdf = copies_.of(tables->column_cdf.data(), tables->column_cdf.size());
    if (dome.column_guide)
      dome.column_guide = copies_.of(tables->column_guide.data(), tables->column_guide.size());
  }
  std::vector<kernels::PortalView> portals = lights.portals;
  for (std::size_t i = 0; i < portals.size(); ++i) {
    const PortalMap& map = *lights.portal_maps[i];
    portals[i].sums = copies_.of(map.sums.data(), map.sums.size());
  }
  dome.portals = copies_.of_own(std::span<const kernels::PortalView>(portals));
}

void CudaScene::copy_volumes() {
  const Snapshot& snapshot = host_->snapshot();
  volumes_.assign(view_.volumes, view_.volumes + view_.volume_count);
  for (std::size_t i = 0; i < volumes_.size(); ++i) {
    const u32 entity = host_->structure().volumes[i].entity;
    const Volume& volume = *snapshot.find(snapshot.entities.at(entity).volume)->value;
    const auto copy = [&](const std::shared_ptr<const Grid>& grid, GridView& out) {
      if (!grid) return;
      const u64 cells = u64(out.cells.x) * u64(out.cells.y) * u64(out.cells.z);
      out.values = copies_.of(out.values, grid->values.size());
      out.bricks = copies_.of(out.bricks, cells);
      out.majorants = copies_.of(out.majorants, grid->channels == 1 ? cells : 0);
    };
    copy(volume.density, volumes_[i].density);
    copy(volume.temperature, volumes_[i].temperature);
    copy(volume.color, volumes_[i].color);
  }
  view_.volumes = copies_.of(volumes_.data(), volumes_.size());
}

/// The trees over meshes. Those of an entity's own vertices are built on the device.
std::vector<kernels::MeshBvh> CudaScene::copy_trees(const TreeBuilder& builder) {
  std::vector<kernels::MeshBvh> trees;
  for (const auto& placed : host_->placement().meshes) {
    const MeshView& mesh = meshes_[trees.size()];
    if (placed->is_deformed() && mesh.triangle_count > kMostHostTriangles) {
      const auto build = [&] { return builder.build(mesh); };
      const DeviceMemory* tree = copies_.made(placed->accelerator.get(), build);
      trees.push_back(tree ? view_of_mesh(*tree, mesh) : kernels::MeshBvh{});
      continue;
    }
    const bvh::BvhTree& tree = bvh::tree_of(*placed);
    trees.push_back({copies_.of(tree.nodes.data(), tree.nodes.size()),
                     copies_.of(tree.triangles.data(), tree.triangles.size()),
                     copies_.of(tree.triangle_numbers.data(), tree.triangle_numbers.size())});
  }
  return trees;
}

void CudaScene::copy_bvh(const TreeBuilder& builder) {
  const Placement& placement = host_->placement();
  const u32 count = u32(placement.instances.size());
  if (count == 0) return;
  const std::vector<kernels::MeshBvh> meshes = copy_trees(builder);
  const auto* table = copies_.of_own(std::span<const kernels::MeshBvh>(meshes));
  // The host's top level would need its trees of deformed meshes.
  const bool deforms =
      std::ranges::any_of(placement.meshes, [](const auto& mesh) { return mesh->is_deformed(); });
  if (count <= kMostHostInstances && !deforms) {
    copy_top(meshes);
    bvh_.meshes = table;
    return;
  }
  BuildInput input{view_.instances, view_.motion_keys, table, count, {}};
  std::vector<kernels::BvhBox> boxes;
  const auto build = [&] {
    for (const auto& mesh : placement.meshes) {
      const Box box = mesh->accelerator->bounds();
      boxes.push_back({box.lower, box.upper});
    }
    input.mesh_boxes = boxes;
    return builder.build(input);
  };
  const DeviceMemory* top = copies_.made(placement.accelerator.get(), build);
  if (top) bvh_ = view_of_top(*top, input);
}

/// The tree that the host builds.
///
/// meshes   as the device has them
void CudaScene::copy_top(std::span<const kernels::MeshBvh> meshes) {
  const bvh::BvhTop& top = bvh::bvh_of(host_->placement())->world(host_->placement());
  std::vector<kernels::BvhInstance> items = top.items;
  for (kernels::BvhInstance& item : items) {
    item.nodes = meshes[item.mesh].nodes;
    item.triangles = meshes[item.mesh].triangles;
  }
  bvh_.top = copies_.of(top.nodes.data(), top.nodes.size());
  bvh_.items = copies_.of_own(std::span<const kernels::BvhInstance>(items));
  bvh_.item_of_instance = copies_.of(top.item_of_instance.data(), top.item_of_instance.size());
  bvh_.instance_count = u32(items.size());
}

}  // namespace heliograph::cuda
