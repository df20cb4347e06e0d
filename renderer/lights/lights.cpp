// Emission to lights.
#include "renderer/lights/lights.h"

#include <algorithm>
#include <cmath>
#include <span>
#include <unordered_map>

#include "kernels/light/light_flat.h"
#include "renderer/base/parallel.h"
#include "renderer/lights/light_bounds.h"
#include "renderer/lights/same_lights.h"
#include "renderer/scene/light_shapes.h"

namespace heliograph::resident {
namespace {

// A light far dimmer than the others still gets this share of the mean: it may be the only one that
// a corner of the scene sees.
constexpr double kSmallestShare = 1e-3;
// Least share, for each of the three, of what all lights of the tree, all suns and the dome send.
constexpr double kSmallestGroupShare = 0.1;
// Share that counts of a dome without a picture, whose light scattered rays find as well, where it
// competes with lights: 2 to 5 % less variance in the scene of `heliograph dataset mesh`.
constexpr double kEvenDome = 0.1;

// A profile that sends less to the back counts as one that sends nothing there.
constexpr double kNoBack = 1e-9;

/// Mean of what a texture use multiplies by, in its channel and as a colour; positive wherever the
/// texture may be.
struct Factor {
  float channel = 1;
  vec3 color{1};
};
Factor mean_factor(const Snapshot& snapshot, const TextureUse& use, DerivedCache& cache) {
  const Shared<Texture>* row = snapshot.find(use.texture);
  if (!row) return {};
  const float least = 1e-3f * (std::abs(use.scale) + std::abs(use.offset));
  const vec4 mean = texture_mean(*row->value, cache) * use.scale + use.offset;
  const vec4 positive = glm::max(mean, vec4(least));
  return {positive[int(std::min(use.channel, 3u))], vec3(positive)};
}

bool black(vec3 c) { return !(c.x > 0 || c.y > 0 || c.z > 0); }

vec3 material_emission(const Snapshot& snapshot, const Material& material, DerivedCache& cache) {
  const Parameter& color = material[MaterialParameter::emission];
  const Parameter& strength = material[MaterialParameter::emission_strength];
  if (black(color.value) || !(strength.value.x > 0)) return vec3(0);
  return color.value * mean_factor(snapshot, color.texture, cache).color * strength.value.x *
         mean_factor(snapshot, strength.texture, cache).channel;
}

/// sin^2 of an angle's quarter, twice: 1 - the cosine of its half.
double disc_depth(double angle) { return 2 * std::pow(std::sin(0.25 * angle), 2); }

std::shared_ptr<const TopTree> make_top_tree(std::vector<kernels::LightBounds> bounds) {
  auto top = std::make_shared<TopTree>();
  LightTree tree = build_light_tree(bounds, 1);
  top->leaves.resize(bounds.size());
  for (u32 i = 0; i < tree.nodes.size(); ++i) {
    kernels::LightNode& node = tree.nodes[i];
    if (node.count == 0) continue;
    node.first = tree.order[node.first];
    top->leaves[node.first] = i;
  }
  top->bounds = std::move(bounds);
  top->nodes = std::move(tree.nodes);
  return top;
}

/// Bounds of a light in object space, given those of its triangles. forward: nothing goes behind
/// the plane of its axis.
kernels::LightBounds light_bounds(kernels::LightBounds bounds, kernels::Shape shape, bool forward) {
  if (shape != kernels::Shape::kTriangles) {
    const vec3 reach = kernels::shape_reach(shape);
    bounds = {.lower = -reach, .upper = reach, .axis = {0, 0, -1}};
    bounds.cos_spread = kernels::is_round(shape) ? -1 : 1;
  }
  if (forward) bounds.cos_spread = 1;
  return bounds;
}

/// Makes Lights step by step.
class Lighter {
 public:
  Lighter(const LightSources& sources, const LightsBefore* before, DerivedCache& cache)
      : snapshot_(sources.snapshot),
        placement_(sources.placement),
        materials_(*sources.materials),
        before_(before ? before->lights.get() : nullptr),
        same_slots_(before && has_same_slots(sources, *before)),
        cache_(cache) {}

  std::shared_ptr<const Lights> make() {
    made_->part_trees.resize(placement_.meshes.size());
    made_->emitters = same_slots_ ? before_->emitters
                                  : std::make_shared<const std::vector<u32>>(slots_that_may_emit());
    for (const u32 i : *made_->emitters) add(i);
    set_part_lights();
    made_->groups = placement_.structure->groups;
    for (u32 i = 1; i < made_->groups.size(); ++i) groups_[made_->groups[i]] = i;
    for (const u32 entity : placement_.structure->suns) add_sun(entity);
    distribute(add_dome());
    return std::move(made_);
  }

 private:
  [[nodiscard]] std::vector<u32> slots_that_may_emit();
  void add(u32 index);
  void add_part(u32 index, u32 part, const kernels::LightView& base, double radiosity);
  void add_shape(u32 index, const Light& light);
  void add_light(const kernels::LightView& base, u32 part, double power, bool forward);
  [[nodiscard]] EmissionMap emission_map(u32 index, u32 part) const;
  void add_sun(u32 entity);
  double add_dome();  // returns its luminance, integrated over the sphere
  void add_portals(const Texture* texture);
  [[nodiscard]] double scene_section() const;
  void distribute(double dome);
  const PartTrees& trees(u32 mesh) {
    auto& entry = made_->part_trees[mesh];
    if (!entry) entry = part_trees(*placement_.meshes[mesh], {}, cache_);
    return *entry;
  }
  vec3 emission_of(u32 row);
  void set_part_lights();
  u32 group_of(const std::string* name);

  const Snapshot& snapshot_;
  const Placement& placement_;
  const Materials& materials_;
  const Lights* before_;
  const bool same_slots_;  // as those that it was made of
  DerivedCache& cache_;
  std::shared_ptr<Lights> made_ = std::make_shared<Lights>();
  std::vector<std::optional<vec3>> emissions_;  // by material row
  std::vector<kernels::LightBounds> bounds_;    // by light
  std::unordered_map<std::string, u32> groups_;
};

vec3 Lighter::emission_of(u32 row) {
  if (row >= snapshot_.materials.capacity()) return vec3(0);
  if (emissions_.empty()) emissions_.resize(snapshot_.materials.capacity());
  auto& known = emissions_[row];
  if (!known) known = material_emission(snapshot_, *snapshot_.materials.at(row).value, cache_);
  return *known;
}

u32 Lighter::group_of(const std::string* name) {
  if (!name || name->empty()) return 0;
  const auto [entry, is_new] = groups_.try_emplace(*name, u32(made_->groups.size()));
  if (is_new) made_->groups.push_back(*name);
  return entry->second;
}

void Lighter::set_part_lights() {
  if (made_->lights.empty()) return;
  made_->part_lights = same_slots_ && has_same_parts(made_->lights, before_->lights)
                           ? before_->part_lights
                           : part_lights_of(*placement_.structure, made_->lights);
}

/// By entity or material, in their order.
std::vector<u32> Lighter::slots_that_may_emit() {
  const Structure& structure = *placement_.structure;
  std::vector<u8> emits_part(structure.part_materials.size());
  for (std::size_t p = 0; p < emits_part.size(); ++p)
    emits_part[p] = !black(emission_of(structure.part_materials[p]));
  std::vector<u8> may(structure.slots.size());
  constexpr std::size_t kGrain = 1024;
  parallel_ranges(may.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Slot& slot = structure.slots[i];
      // Light of curves is found by rays that scatter alone.
      if (placement_.mesh(i).shape() == kernels::Shape::kCurves) continue;
      const u32 parts = placement_.mesh(i).topology->part_count;
      const auto own = std::span(emits_part).subspan(slot.first_part, parts);
      may[i] = snapshot_.entities.at(slot.entity).light || std::ranges::count(own, 1) > 0;
    }
  });
  std::vector<u32> slots;
  for (u32 i = 0; i < may.size(); ++i)
    if (may[i]) slots.push_back(i);
  return slots;
}

void Lighter::add(u32 index) {
  const Slot& slot = placement_.structure->slots[index];
  const Entity& entity = snapshot_.entities.at(slot.entity);
  if (has_light_shape(entity)) return add_shape(index, *entity.light);
  const u32 mesh_index = placement_.slots[index].mesh;
  const DeviceMesh& mesh = *placement_.meshes[mesh_index];
  const u32 parts = mesh.topology->part_count;

  kernels::LightView base{};
  base.instance = index;
  base.texture.texture = kNone;
  vec3 mean(0);
  if (entity.light && entity.light->sun_angle == 0 && emits(*entity.light)) {
    const Light& light = *entity.light;
    double area = 0;
    for (u32 p = 0; p < parts; ++p)
      area += part_area(mesh, trees(mesh_index), placement_.world[slot.entity], p);
    base.radiance = light_radiance(light, mesh_extent(area, light.two_sided));
    base.texture = view_of(snapshot_, light.texture);
    base.light_two_sided = light.two_sided;
    mean = base.radiance * mean_factor(snapshot_, light.texture, cache_).color;
  }
  for (u32 p = 0; p < parts; ++p) {
    const u32 material = placement_.structure->part_materials[slot.first_part + p];
    const vec3 emission = emission_of(material);
    kernels::LightView light = base;
    light.material_emits = !black(emission);
    light.material_two_sided = materials_.materials[material].two_sided_emission;
    if (black(mean) && !light.material_emits) continue;
    const double power = kernels::luminance(mean) * (light.light_two_sided ? 2 : 1) +
                         kernels::luminance(emission) * (light.material_two_sided ? 2 : 1);
    add_part(index, p, light, power);
  }
}

void Lighter::add_part(u32 index, u32 part, const kernels::LightView& base, double radiosity) {
  const Slot& slot = placement_.structure->slots[index];
  const u32 mesh = placement_.slots[index].mesh;
  const double area =
      part_area(*placement_.meshes[mesh], trees(mesh), placement_.world[slot.entity], part);
  if (!(area > 0)) return;
  add_light(base, part, M_PI * area * radiosity, false);
}

void Lighter::add_shape(u32 index, const Light& light) {
  const mat4x3 pose = placement_.mesh_pose(index);
  const Shared<Texture>* picture = snapshot_.find(light.profile);
  const auto profile = picture ? profile_sums(*picture->value, cache_) : nullptr;
  const LightExtent extent = shape_extent(light, pose, profile.get());
  if (!emits(light) || !(extent.flux > 0)) return;
  const LightCone cone = cone_of(light);
  kernels::LightView base{};
  base.instance = index;
  base.radiance = light_radiance(light, extent);
  base.texture = view_of(snapshot_, light.texture);
  base.light_two_sided = light.two_sided;
  base.cone_cos = cone.cosine;
  base.cone_scale = cone.scale;
  if (profile) base.profile = light.profile.index();
  const bool forward = cone.scale > 0 || (profile && profile->back <= kNoBack * profile->front);
  const vec3 mean = base.radiance * mean_factor(snapshot_, light.texture, cache_).color;
  if (!black(mean)) add_light(base, 0, extent.flux * double(kernels::luminance(mean)), forward);
}

void Lighter::add_light(const kernels::LightView& base, u32 part, double power, bool forward) {
  if (!std::isfinite(power)) return;
  const u32 mesh = placement_.slots[base.instance].mesh;
  made_->lights.push_back(base);
  kernels::LightView& light = made_->lights.back();
  light.part = part;
  const EmissionMap map = emission_map(base.instance, part);
  if (map.texture) made_->mapped_trees.push_back(part_trees(*placement_.meshes[mesh], map, cache_));
  const PartTrees& chosen = map.texture ? *made_->mapped_trees.back() : trees(mesh);
  light.tree = chosen.view(part);
  const kernels::InstanceView instance = placement_.instance(base.instance);
  const kernels::LightBounds own =
      light_bounds(chosen.bounds[part], placement_.meshes[mesh]->shape(), forward);
  kernels::detect_sphere(light, instance, placement_.meshes[mesh]->shape());
  const kernels::MeshView view = placement_.meshes[mesh]->view();
  kernels::add_flat_triangles(light, instance, view, made_->flat_triangles);
  bounds_.push_back(world_bounds(own, instance, placement_.keys_of(base.instance)));
  bounds_.back().power = float(power);
  bounds_.back().two_sided = kernels::emits_back(light);
  if (forward) bounds_.back().axis = -glm::normalize(instance.world_from_object[2]);
}

/// The texture that a part's emission varies with: its light's, or else its material's.
EmissionMap Lighter::emission_map(u32 index, u32 part) const {
  const Slot& slot = placement_.structure->slots[index];
  const Entity& entity = snapshot_.entities.at(slot.entity);
  const TextureUse* use = entity.light && emits(*entity.light) ? &entity.light->texture : nullptr;
  const u32 row = placement_.structure->part_materials[slot.first_part + part];
  if ((!use || !use->texture) && row < snapshot_.materials.capacity())
    use = &(*snapshot_.materials.at(row).value)[MaterialParameter::emission].texture;
  const Shared<Texture>* texture = use ? snapshot_.find(use->texture) : nullptr;
  return texture ? EmissionMap{texture->value.get(), *use} : EmissionMap{};
}

/// Area of a disc that hides the scene from a direction, m^2.
double Lighter::scene_section() const {
  const Box& bounds = placement_.bounds;
  const double radius = bounds.empty() ? 1 : 0.5 * double(glm::length(bounds.upper - bounds.lower));
  return M_PI * radius * radius;
}

void Lighter::add_sun(u32 index) {
  const Entity& entity = snapshot_.entities.at(index);
  const Light& light = *entity.light;
  const vec3 axis = kernels::normalize_or(placement_.world[index][2], vec3(0));
  if (!emits(light) || black(glm::abs(axis))) return;
  kernels::SunView sun{};
  sun.direction = axis;
  sun.one_minus_cos = float(disc_depth(double(light.sun_angle)));
  sun.radiance = light_radiance(light, {});
  sun.visibility = entity.visibility;
  sun.light_group = group_of(entity.light_group.get());
  made_->sun_keys.push_back(pointing_keys(snapshot_, index, placement_.span, 0));
  if (const auto& keys = made_->sun_keys.back(); !keys.empty()) {
    sun.motion_keys = keys.data();
    sun.segments = u32(keys.size() - 1);
  }
  made_->suns.push_back(sun);
}

double Lighter::add_dome() {
  kernels::DomeView& view = made_->dome;
  view.texture = kNone;
  view.world_from_dome = view.dome_from_world = mat3(1);
  if (!snapshot_.dome) return 0;
  const Dome& dome = *snapshot_.dome;
  const Shared<Texture>* texture = snapshot_.find(dome.texture);
  view.radiance = dome.color.value_or(vec3(texture ? 1 : 0)) * dome.intensity;
  view.world_from_dome = dome.world_from_dome;
  view.dome_from_world = glm::transpose(dome.world_from_dome);
  view.camera_visible = dome.camera_visible;
  view.light_group = group_of(&dome.light_group);
  if (black(view.radiance)) return 0;
  vec3 integral(float(4 * M_PI));
  if (texture) {
    view.texture = dome.texture.index();
    made_->dome_tables = dome_tables(*texture->value, cache_);
    const DomeTables& tables = *made_->dome_tables;
    view.width = texture->value->image->width;
    view.height = texture->value->image->height;
    view.row_cdf = tables.row_cdf.data();
    view.column_cdf = tables.column_cdf.data();
    if (!tables.guides.empty()) view.guides = tables.guides.data();
    integral = tables.integral;
  }
  add_portals(texture ? texture->value.get() : nullptr);
  return double(kernels::luminance(integral * view.radiance));
}

void Lighter::add_portals(const Texture* texture) {
  kernels::DomeView& dome = made_->dome;
  for (const u32 index : placement_.structure->portals) {
    kernels::PortalView view{};
    const Portal& portal = *snapshot_.entities.at(index).portal;
    if (!place_portal(portal, placement_.world[index], view)) continue;
    made_->portal_maps.push_back(portal_map(texture, dome, view, cache_));
    view.sums = made_->portal_maps.back()->sums.data();
    made_->portals.push_back(view);
  }
  dome.portals = made_->portals.data();
  dome.portal_count = u32(made_->portals.size());
}

/// Shares of the lights, of the suns and of the dome in proportion to their power, none too small.
void Lighter::distribute(double dome) {
  double total = 0;
  for (const auto& b : bounds_) total += double(b.power);
  // All may be too dim for a float, or too many.
  const double least = total > 0 ? kSmallestShare * total / double(bounds_.size()) : 1;
  double lamps = 0, all_suns = 0;
  for (auto& b : bounds_) {
    b.power = std::max(b.power, float(least));
    lamps += double(b.power);
  }
  std::vector<double> suns;
  for (const auto& sun : made_->suns) {
    suns.push_back(2 * M_PI * double(sun.one_minus_cos * kernels::luminance(sun.radiance)));
    all_suns += suns.back();
  }
  glm::dvec3 shares(lamps, scene_section() * all_suns, scene_section() * dome);
  const double all = shares.x + shares.y + shares.z;
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    if (shares[i] > 0) sum += shares[i] = std::max(shares[i] / all, kSmallestGroupShare);
  if (sum > 0) shares /= sum;
  double sun_sum = 0;
  for (double& s : suns) sun_sum += s = std::max(s, kSmallestShare * all_suns);
  const double sky = shares.y + shares.z;
  for (std::size_t i = 0; i < suns.size(); ++i)
    made_->suns[i].probability = float(shares.y / sky * suns[i] / sun_sum);
  made_->dome_share = float(shares.z);
  made_->dome.probability = sky > 0 ? float(shares.z / sky) : 0;
  const double dome_needs = made_->dome_tables ? dome : kEvenDome * dome;
  made_->sky_power = float(4 * M_PI * (all_suns + dome_needs));
  if (before_) made_->tree = before_->tree;
  if (!before_ || made_->tree->bounds != bounds_) made_->tree = make_top_tree(std::move(bounds_));
  for (std::size_t i = 0; i < made_->lights.size(); ++i)
    made_->lights[i].leaf = made_->tree->leaves[i];
}

}  // namespace

std::shared_ptr<const Lights> make_lights(const LightSources& sources, const LightsBefore* before,
                                          DerivedCache& cache) {
  if (before && has_same_sources(sources, *before)) return before->lights;
  return Lighter(sources, before, cache).make();
}

}  // namespace heliograph::resident
