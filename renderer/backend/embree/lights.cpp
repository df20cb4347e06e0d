// Emission to lights.
#include "renderer/backend/embree/lights.h"

#include "kernels/light_triangle.h"

#include <cmath>
#include <unordered_map>

namespace heliograph::embree {
namespace {

constexpr double kLumensPerWatt = 683;
// A light far dimmer than the others still gets this share of the mean: it may be the only one that
// a corner of the scene sees.
constexpr double kSmallestShare = 1e-3;
// Of the lights of the tree, of the suns and of the dome, where others exist.
constexpr double kSmallestGroupShare = 0.1;

float luminance(vec3 c) { return glm::dot(c, vec3(0.2126f, 0.7152f, 0.0722f)); }

/// Gaussian with different widths on the two sides.
double lobe(double x, double mean, double below, double above) {
  const double t = (x - mean) / (x < mean ? below : above);
  return std::exp(-0.5 * t * t);
}

/// Area factor of a linear map where it is the same for every direction; nullopt otherwise.
std::optional<double> area_scale(const mat4x3& m) {
  const vec3 x = m[0], y = m[1], z = m[2];
  const float s = glm::dot(x, x), tolerance = 1e-4f * s;
  const bool similar = std::abs(glm::dot(y, y) - s) < tolerance &&
                       std::abs(glm::dot(z, z) - s) < tolerance &&
                       std::abs(glm::dot(x, y)) < tolerance &&
                       std::abs(glm::dot(x, z)) < tolerance && std::abs(glm::dot(y, z)) < tolerance;
  return similar ? std::optional<double>(s) : std::nullopt;
}

double part_area(const DeviceMesh& mesh, const PartTrees& trees, const mat4x3& world, u32 part) {
  if (const auto scale = area_scale(world)) return *scale * double(trees.bounds[part].power);
  double area = 0;
  const mat3 linear(world);
  for (u32 i = trees.offsets[part]; i < trees.offsets[part + 1]; ++i) {
    const uvec3 t = mesh.topology->triangles[trees.entries[i].triangle];
    const vec3 a = mesh.positions[t.x];
    area += 0.5 * glm::length(glm::cross(linear * (mesh.positions[t.y] - a),
                                         linear * (mesh.positions[t.z] - a)));
  }
  return area;
}

/// Bounds in the world of what has `bounds` in an instance's object space, but for the power.
kernels::LightBounds world_bounds(const kernels::LightBounds& bounds,
                                  const kernels::InstanceView& instance) {
  const mat4x3& m = instance.world_from_object;
  const vec3 center = kernels::transform_point(m, 0.5f * (bounds.lower + bounds.upper));
  const vec3 half = 0.5f * (bounds.upper - bounds.lower);
  const vec3 extent = glm::abs(m[0]) * half.x + glm::abs(m[1]) * half.y + glm::abs(m[2]) * half.z;
  kernels::LightBounds world = bounds;
  world.lower = center - extent;
  world.upper = center + extent;
  world.axis = kernels::normalize_or(
      kernels::transform_normal(instance.object_from_world, bounds.axis), vec3(0, 0, 1));
  // Only similar maps keep the angles of a cone; a single normal has none.
  if (bounds.cos_spread < 1 && !area_scale(m)) world.cos_spread = -1;
  return world;
}

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

vec3 material_emission(const Snapshot& snapshot, const Material& material, DerivedCache& cache) {
  const Parameter& color = material[MaterialParameter::emission];
  const Parameter& strength = material[MaterialParameter::emission_strength];
  return color.value * mean_factor(snapshot, color.texture, cache).color * strength.value.x *
         mean_factor(snapshot, strength.texture, cache).channel;
}

bool black(vec3 c) { return !(c.x > 0 || c.y > 0 || c.z > 0); }

bool emits(const Light& light) { return !black(light.color) && light.intensity > 0; }

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

/// Makes Lights step by step.
class Lighter {
 public:
  Lighter(const Snapshot& snapshot, const Placement& placement, const Materials& materials,
          const Lights* before, DerivedCache& cache)
      : snapshot_(snapshot),
        placement_(placement),
        materials_(materials),
        before_(before),
        cache_(cache) {}

  std::shared_ptr<const Lights> make() {
    made_->part_lights.assign(placement_.structure->part_materials.size(), kNone);
    made_->part_trees.resize(placement_.meshes.size());
    for (u32 i = 0; i < placement_.structure->slots.size(); ++i) add(i);
    group_slots();
    for (const u32 entity : placement_.structure->suns) add_sun(entity);
    const double dome = add_dome();
    distribute(dome);
    return std::move(made_);
  }

 private:
  void add(u32 index);
  void add_part(u32 index, u32 part, const kernels::LightView& base, double sides);
  void add_sun(u32 entity);
  double add_dome();
  [[nodiscard]] double scene_section() const;
  void distribute(double dome_power);
  const PartTrees& trees(u32 mesh) {
    auto& entry = made_->part_trees[mesh];
    if (!entry) entry = part_trees(*placement_.meshes[mesh], cache_);
    return *entry;
  }
  vec3 emission_of(u32 row);
  void group_slots();
  u32 group_of(const std::string* name);

  const Snapshot& snapshot_;
  const Placement& placement_;
  const Materials& materials_;
  const Lights* before_;
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

void Lighter::group_slots() {
  for (const Slot& slot : placement_.structure->slots)
    made_->group_of_slot.push_back(group_of(snapshot_.entities.at(slot.entity).light_group.get()));
}

void Lighter::add(u32 index) {
  const Slot& slot = placement_.structure->slots[index];
  const Entity& entity = snapshot_.entities.at(slot.entity);
  const u32 mesh_index = placement_.mesh_of_slot[index];
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
    base.radiance = light_radiance(light, area * (light.two_sided ? 2 : 1));
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
    const double power = luminance(mean) * (light.light_two_sided ? 2 : 1) +
                         luminance(emission) * (light.material_two_sided ? 2 : 1);
    add_part(index, p, light, power);
  }
}

void Lighter::add_part(u32 index, u32 part, const kernels::LightView& base, double radiosity) {
  const Slot& slot = placement_.structure->slots[index];
  const u32 mesh = placement_.mesh_of_slot[index];
  const double area =
      part_area(*placement_.meshes[mesh], trees(mesh), placement_.world[slot.entity], part);
  if (!(area > 0) || !std::isfinite(radiosity)) return;
  made_->part_lights[slot.first_part + part] = u32(made_->lights.size());
  made_->lights.push_back(base);
  kernels::LightView& light = made_->lights.back();
  light.part = part;
  light.tree = trees(mesh).view(part);
  bounds_.push_back(world_bounds(trees(mesh).bounds[part], placement_.instances[index]));
  bounds_.back().power = float(M_PI * area * radiosity);
  bounds_.back().two_sided = kernels::emits_back(light);
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
  sun.depth = float(disc_depth(double(light.sun_angle)));
  sun.radiance = light_radiance(light, 0);
  sun.visibility = entity.visibility;
  sun.light_group = group_of(entity.light_group.get());
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
    if (!tables.column_guide.empty()) view.column_guide = tables.column_guide.data();
    integral = tables.integral;
  }
  return scene_section() * double(luminance(integral * view.radiance));
}

/// Shares of the lights, of the suns and of the dome in proportion to their power, none too small.
void Lighter::distribute(double dome_power) {
  double total = 0;
  for (const auto& b : bounds_) total += double(b.power);
  // All may be too dim for a float, or too many.
  const double least = total > 0 ? kSmallestShare * total / double(bounds_.size()) : 1;
  glm::dvec3 shares(0, 0, dome_power);
  for (auto& b : bounds_) {
    b.power = std::max(b.power, float(least));
    shares.x += double(b.power);
  }
  std::vector<double> suns;
  for (const auto& sun : made_->suns) {
    suns.push_back(scene_section() * 2 * M_PI * double(sun.depth * luminance(sun.radiance)));
    shares.y += suns.back();
  }
  const double all = shares.x + shares.y + shares.z, sun_power = shares.y;
  double sum = 0;
  for (int i = 0; i < 3; ++i)
    if (shares[i] > 0) sum += shares[i] = std::max(shares[i] / all, kSmallestGroupShare);
  if (sum > 0) shares /= sum;
  double sun_sum = 0;
  for (double& s : suns) sun_sum += s = std::max(s, kSmallestShare * sun_power);
  for (std::size_t i = 0; i < suns.size(); ++i)
    made_->suns[i].probability = float(shares.y * suns[i] / sun_sum);
  made_->surface_probability = float(shares.x);
  made_->dome.probability = float(shares.z);
  made_->tree = before_ && before_->tree->bounds == bounds_ ? before_->tree
                                                            : make_top_tree(std::move(bounds_));
  for (std::size_t i = 0; i < made_->lights.size(); ++i)
    made_->lights[i].leaf = made_->tree->leaves[i];
}

}  // namespace

vec3 planckian_color(double kelvin) {
  // CIE 1931 colour matching functions as sums of lobes.
  // Source: Wyman, Sloan & Shirley 2013, "Simple Analytic Approximations to the CIE XYZ Color
  // Matching Functions", JCGT 2(2), equation 4.
  glm::dvec3 xyz(0);
  for (double nm = 360; nm <= 830; nm += 5) {
    const double power = std::pow(nm * 1e-3, -5) / std::expm1(1.438776877e7 / (nm * kelvin));
    xyz.x += power * (1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7) -
                      0.065 * lobe(nm, 501.1, 20.4, 26.2));
    xyz.y += power * (0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1));
    xyz.z += power * (1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8));
  }
  const glm::dvec3 red(3.2404542, -1.5371385, -0.4985314), green(-0.9692660, 1.8760108, 0.0415560),
      blue(0.0556434, -0.2040259, 1.0572252);
  const vec3 rgb = glm::max(
      vec3(glm::dot(red, xyz), glm::dot(green, xyz), glm::dot(blue, xyz)) / float(xyz.y), vec3(0));
  return rgb / luminance(rgb);
}

vec3 light_radiance(const Light& light, double area) {
  double scale = double(light.intensity) * std::exp2(double(light.exposure));
  if (light.unit == LightUnit::kLuminance || light.unit == LightUnit::kLumen ||
      light.unit == LightUnit::kIlluminance)
    scale /= kLumensPerWatt;
  if (light.unit == LightUnit::kIrradiance || light.unit == LightUnit::kIlluminance)
    scale /= M_PI * std::pow(std::sin(0.5 * double(light.sun_angle)), 2);
  if (light.unit == LightUnit::kPower || light.unit == LightUnit::kLumen)
    scale = area > 0 ? scale / (M_PI * area) : 0;
  const vec3 tint = light.temperature > 0 ? planckian_color(double(light.temperature)) : vec3(1);
  return light.color * tint * float(scale);
}

std::shared_ptr<const Lights> make_lights(const Snapshot& snapshot, const Placement& placement,
                                          const Materials& materials, const Lights* before,
                                          DerivedCache& cache) {
  return Lighter(snapshot, placement, materials, before, cache).make();
}

}  // namespace heliograph::embree
