// Views of the host to views of the device: the same, but for where their arrays lie.
#include "renderer/backend/cuda/scene.h"

#include <algorithm>
#include <unordered_map>

#include "kernels/material/texture.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/scene/grid.h"

namespace heliograph::cuda {

namespace {

/// More instances than these are made on the device, and trees over them built there.
constexpr u32 kMostHostInstances = 512;
/// The same of triangles of a mesh that deforms.
constexpr u32 kMostHostTriangles = 512;

bool any_deforms(const Placement& placement) {
  return std::ranges::any_of(placement.meshes,
                             [](const auto& mesh) { return mesh->is_deformed(); });
}

/// The host's top level would need its trees of deformed meshes.
bool has_host_top(const Placement& placement) {
  return placement.slots.size() <= kMostHostInstances && !any_deforms(placement);
}

void copy_mesh(kernels::MeshView& m, Copies& copies) {
  const u64 triangles = m.triangle_count, vertices = m.vertex_count;
  const u64 keyed = vertices * (m.segments + 1);
  m.triangles = copies.of(m.triangles, triangles);
  m.positions = copies.of(m.positions, keyed);
  m.normals = copies.of(m.normals, keyed);
  m.rest_positions = copies.of(m.rest_positions, vertices);
  m.uvs = copies.of(m.uvs, vertices);
  m.uvs1 = copies.of(m.uvs1, vertices);
  m.colors = copies.of(m.colors, vertices);
  m.tangents = copies.of(m.tangents, vertices);
  m.parts = copies.of(m.parts, triangles);
  m.strand_points = copies.of(m.strand_points, vertices);
}

/// True if the tree over a mesh, of an entity's own vertices, is built on the device.
bool is_built(const DeviceMesh& mesh) {
  return mesh.is_deformed() && mesh.topology->triangles.size() > kMostHostTriangles;
}

kernels::MeshBvh copy_tree(const bvh::BvhTree& tree, Copies& copies) {
  return {copies.of(tree.nodes.data(), tree.nodes.size()),
          copies.of(tree.triangles.data(), tree.triangles.size()),
          copies.of(tree.triangle_numbers.data(), tree.triangle_numbers.size())};
}

template <class F>
std::shared_ptr<const CudaScene> find_in(const CopyContext& context, const F& fits) {
  if (context.sibling && fits(*context.sibling)) return context.sibling;
  return context.others.find(fits);
}

/// like   of another scene, over the same triangles; null: there is none
Expected<std::shared_ptr<const MeshCopies>> copy_meshes(const ResidentScene& host,
                                                        const CopyContext& context,
                                                        const MeshCopies* like) {
  auto made = std::make_shared<MeshCopies>(context.mirror);
  made->of = host.placement().meshes;
  made->views.assign(host.view_without_instances().meshes,
                     host.view_without_instances().meshes + made->of.size());
  for (std::size_t i = 0; i < made->of.size(); ++i) {
    const DeviceMesh& mesh = *made->of[i];
    kernels::MeshView& view = made->views[i];
    copy_mesh(view, made->copies);
    made->built.push_back(nullptr);
    if (is_built(mesh)) {
      const auto before = like ? MeshBefore{like->built[i], like->views[i]} : MeshBefore{};
      const auto build = [&] { return context.builder.build(view, before); };
      const DeviceMemory* tree = made->copies.made(mesh.accelerator.get(), build);
      made->built.back() = tree;
      made->trees.push_back(tree ? view_of_mesh(*tree, view) : kernels::MeshBvh{});
    } else {
      made->trees.push_back(copy_tree(bvh::tree_of(mesh), made->copies));
    }
  }
  made->view_table = made->copies.of_own(std::span<const kernels::MeshView>(made->views));
  made->tree_table = made->copies.of_own(std::span<const kernels::MeshBvh>(made->trees));
  HELIO_TRY(made->copies.finish());
  return made;
}

Expected<std::shared_ptr<const MaterialCopies>> copy_materials(
    const std::shared_ptr<const Materials>& materials, Mirror& mirror) {
  auto made = std::make_shared<MaterialCopies>(mirror);
  Copies& copies = made->copies;
  made->of = materials;
  std::vector<kernels::TextureView> textures = materials->textures;
  for (kernels::TextureView& t : textures) {
    if (!t.texels) continue;
    t.texels = copies.of(static_cast<const std::byte*>(t.texels), kernels::texture_bytes(t));
    t.mips = copies.of(static_cast<const std::byte*>(t.mips), kernels::mip_bytes(t));
  }
  made->textures = copies.of_own(std::span<const kernels::TextureView>(textures));
  made->materials = copies.of(materials->materials.data(), materials->materials.size());
  made->uses = copies.of(materials->uses.data(), materials->uses.size());
  HELIO_TRY(copies.finish());
  return made;
}

}  // namespace

using kernels::GridView;
using kernels::LightView;

Expected<std::shared_ptr<const CudaScene>> CudaScene::create(
    std::shared_ptr<const ResidentScene> host, const CopyContext& context) {
  std::shared_ptr<CudaScene> scene(new CudaScene(std::move(host), context));
  scene->view_ = scene->host_->view_without_instances();
  HELIO_TRY(scene->find_meshes(context));
  HELIO_TRY(scene->find_materials(context));
  const auto like = find_in(context, [&](const CudaScene& other) {
    return other.host_->placement().structure == scene->host_->placement().structure;
  });
  HELIO_TRY(scene->copy_instances(context.placer, like.get()));
  scene->copy_lights();
  scene->copy_dome();
  scene->copy_volumes();
  scene->copy_bvh(context.builder, like.get());
  HELIO_TRY(scene->copies_.finish());
  return scene;
}

void CudaScene::make_host_trees(const ResidentScene& host) {
  const Placement& placement = host.placement();
  if (placement.slots.size() > 0 && has_host_top(placement))
    (void)bvh::bvh_of(placement)->world(placement);
}

Status CudaScene::find_meshes(const CopyContext& context) {
  const auto other = find_in(context, [&](const CudaScene& scene) {
    return scene.meshes_->of == host_->placement().meshes;
  });
  if (other) {
    meshes_ = other->meshes_;
  } else {
    const auto like = find_in(context, [&](const CudaScene& scene) {
      return std::ranges::equal(scene.meshes_->of, host_->placement().meshes, {},
                                &DeviceMesh::topology, &DeviceMesh::topology);
    });
    auto made = copy_meshes(*host_, context, like ? like->meshes_.get() : nullptr);
    if (!made) return std::unexpected(std::move(made).error());
    meshes_ = *std::move(made);
  }
  view_.meshes = meshes_->view_table;
  return {};
}

Status CudaScene::find_materials(const CopyContext& context) {
  const auto& materials = host_->pieces().materials;
  const auto other =
      find_in(context, [&](const CudaScene& scene) { return scene.materials_->of == materials; });
  if (other) {
    materials_ = other->materials_;
  } else {
    auto made = copy_materials(materials, context.mirror);
    if (!made) return std::unexpected(std::move(made).error());
    materials_ = *std::move(made);
  }
  view_.textures = materials_->textures;
  view_.materials = materials_->materials;
  view_.texture_uses = materials_->uses;
  return {};
}

Status CudaScene::copy_instances(const InstancePlacer& placer, const CudaScene* like) {
  const Placement& placement = host_->placement();
  view_.motion_keys = copies_.of(view_.motion_keys, placement.motion_keys.size());
  const auto& part_materials = placement.structure->part_materials;
  view_.part_materials = copies_.of(part_materials.data(), part_materials.size());
  const u32 count = view_.instance_count;
  if (count <= kMostHostInstances) {
    view_.instances = own_->of_own(placement.instances());
    return {};
  }
  const Placement* before = like ? &like->host_->placement() : nullptr;
  slots_ = before ? copies_.of_changed(placement.slots, before->slots, like->slots_)
                  : copies_.of_own(placement.slots);
  world_ = before ? copies_.of_changed(placement.world, before->world, like->world_)
                  : copies_.of_own(placement.world);
  auto* instances = copies_.room<kernels::InstanceView>(count);
  view_.instances = instances;
  if (!instances) return {};
  return placer.place({slots_, world_, view_.motion_keys, instances, count});
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
  view_.lights = own_->of_own(std::span<const LightView>(views));
  const std::vector<u32>* part_lights = lights.part_lights.get();
  view_.part_lights = part_lights ? copies_.of(part_lights->data(), part_lights->size()) : nullptr;
  view_.light_nodes = copies_.of(lights.tree->nodes.data(), lights.tree->nodes.size());
  std::vector<kernels::SunView> suns = lights.suns;
  for (kernels::SunView& sun : suns)
    if (sun.segments > 0) sun.motion_keys = copies_.of(sun.motion_keys, sun.segments + 1);
  view_.suns = own_->of_own(std::span<const kernels::SunView>(suns));
  view_.casters = own_->of_own(std::span(view_.casters, view_.caster_count));
  view_.cast_lights = own_->of_own(std::span(view_.cast_lights, view_.cast_light_count));
  view_.black_body = copies_.of(view_.black_body, kernels::kBlackBodyEntries);
}

void CudaScene::copy_dome() {
  const Lights& lights = host_->lights();
  kernels::DomeView& dome = view_.dome;
  if (const DomeTables* tables = lights.dome_tables.get()) {
    dome.row_cdf = copies_.of(tables->row_cdf.data(), tables->row_cdf.size());
    dome.column_cdf = copies_.of(tables->column_cdf.data(), tables->column_cdf.size());
    if (dome.guides) dome.guides = copies_.of(tables->guides.data(), tables->guides.size());
  }
  std::vector<kernels::PortalView> portals = lights.portals;
  for (std::size_t i = 0; i < portals.size(); ++i) {
    const PortalMap& map = *lights.portal_maps[i];
    portals[i].sums = copies_.of(map.sums.data(), map.sums.size());
  }
  dome.portals = own_->of_own(std::span<const kernels::PortalView>(portals));
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
  const u64 nodes = volumes_.empty() ? 0 : 2 * volumes_.size() - 1;
  view_.volume_nodes = copies_.of(view_.volume_nodes, nodes);
}

void CudaScene::copy_bvh(const TreeBuilder& builder, const CudaScene* like) {
  const Placement& placement = host_->placement();
  if (placement.slots.size() == 0) return;
  bvh_ = has_host_top(placement) ? copy_top() : built_top(builder, like);
  const bvh::StaticGroup* fixed = bvh::bvh_of(placement)->fixed().get();
  if (!fixed) return;
  const bvh::StaticTree& tree = *fixed->tree;
  bvh_.fixed = {copies_.of(tree.nodes.data(), tree.nodes.size()),
                copies_.of(tree.triangles.data(), tree.triangles.size()),
                copies_.of(fixed->slots.data(), fixed->slots.size())};
}

/// The top level that the device builds.
kernels::BvhView CudaScene::built_top(const TreeBuilder& builder, const CudaScene* like) {
  const Placement& placement = host_->placement();
  BuildInput input{.instances = view_.instances,
                   .motion_keys = view_.motion_keys,
                   .meshes = meshes_->tree_table,
                   .count = u32(placement.slots.size()),
                   .mesh_boxes = {}};
  if (const bvh::StaticGroup* fixed = bvh::bvh_of(placement)->fixed().get()) {
    input.left_out = copies_.of(fixed->bits.data(), fixed->bits.size());
    input.left_out_count = u32(fixed->slots.size());
  }
  if (like && like->view_.instance_count == input.count) input.before = like->top_;
  std::vector<kernels::BvhBox> boxes;
  const auto build = [&] {
    for (const auto& mesh : placement.meshes) {
      const Box box = mesh->accelerator->bounds();
      boxes.push_back({box.lower, box.upper});
    }
    input.mesh_boxes = boxes;
    own_->send();  // instances of the host
    return builder.build(input);
  };
  const DeviceMemory* top = copies_.made(placement.accelerator.get(), build);
  if (!top) return {};
  if (input.has_tree()) top_ = top;
  return view_of_top(*top, input);
}

/// The one that the host builds.
kernels::BvhView CudaScene::copy_top() {
  const bvh::BvhTop& top = bvh::bvh_of(host_->placement())->world(host_->placement());
  std::vector<kernels::BvhInstance> items = top.items;
  for (kernels::BvhInstance& item : items) {
    item.nodes = meshes_->trees[item.mesh].nodes;
    item.triangles = meshes_->trees[item.mesh].triangles;
  }
  return {.top = own_->of_own(std::span<const kernels::BvhNode>(top.nodes)),
          .items = own_->of_own(std::span<const kernels::BvhInstance>(items)),
          .meshes = meshes_->tree_table,
          .item_of_instance = own_->of_own(std::span<const u32>(top.item_of_instance)),
          .instance_count = u32(items.size()),
          .fixed = {}};
}

}  // namespace heliograph::cuda
