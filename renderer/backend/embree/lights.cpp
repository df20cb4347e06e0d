// Emission to lights.
#include "renderer/backend/embree/lights.h"

#include <cmath>

namespace heliograph::embree {
namespace {

constexpr double kLumensPerWatt = 683;
// A light far dimmer than the others still gets this share of the mean: it may be the only one that
// a corner of the scene sees.
constexpr double kSmallestShare = 1e-3;
// Of the dome, where other lights exist, and the other way round.
constexpr double kSmallestDomeShare = 0.1;

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

double part_area(const DeviceMesh& mesh, const PartTables& tables, const mat4x3& world, u32 part) {
  if (const auto scale = area_scale(world)) return *scale * tables.areas[part];
  double area = 0;
  const mat3 linear(world);
  for (u32 i = tables.offsets[part]; i < tables.offsets[part + 1]; ++i) {
    const uvec3 t = mesh.topology->triangles[tables.triangles[i]];
    const vec3 a = mesh.positions[t.x];
    area += 0.5 * glm::length(glm::cross(linear * (mesh.positions[t.y] - a),
                                         linear * (mesh.positions[t.z] - a)));
  }
  return area;
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

/// Makes Lights step by step.
class Lighter {
 public:
  Lighter(const Snapshot& snapshot, const Placement& placement, const Materials& materials,
          const MeshBuilder& builder, DerivedCache& cache)
      : snapshot_(snapshot),
        placement_(placement),
        materials_(materials),
        builder_(builder),
        cache_(cache) {}

  std::shared_ptr<const Lights> make() {
    made_->part_lights.assign(placement_.structure->part_materials.size(), kNone);
    made_->part_tables.resize(placement_.meshes.size());
    for (u32 i = 0; i < placement_.structure->slots.size(); ++i) add(i);
    const double dome = add_dome();
    distribute(dome);
    return std::move(made_);
  }

 private:
  void add(u32 index);
  void add_part(u32 index, u32 part, const kernels::LightView& base, double sides);
  double add_dome();
  void distribute(double dome_power);
  const PartTables& tables(u32 mesh) {
    auto& entry = made_->part_tables[mesh];
    if (!entry) entry = builder_.part_tables(*placement_.meshes[mesh]);
    return *entry;
  }
  vec3 emission_of(u32 row);

  const Snapshot& snapshot_;
  const Placement& placement_;
  const Materials& materials_;
  const MeshBuilder& builder_;
  DerivedCache& cache_;
  std::shared_ptr<Lights> made_ = std::make_shared<Lights>();
  std::vector<std::optional<vec3>> emissions_;  // by material row
  std::vector<double> powers_;
};

vec3 Lighter::emission_of(u32 row) {
  if (row >= snapshot_.materials.capacity()) return vec3(0);
  if (emissions_.empty()) emissions_.resize(snapshot_.materials.capacity());
  auto& known = emissions_[row];
  if (!known) known = material_emission(snapshot_, *snapshot_.materials.at(row).value, cache_);
  return *known;
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
  if (entity.light && !black(entity.light->color) && entity.light->intensity > 0) {
    const Light& light = *entity.light;
    double area = 0;
    for (u32 p = 0; p < parts; ++p)
      area += part_area(mesh, tables(mesh_index), placement_.world[slot.entity], p);
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
      part_area(*placement_.meshes[mesh], tables(mesh), placement_.world[slot.entity], part);
  if (!(area > 0) || !std::isfinite(radiosity)) return;
  made_->part_lights[slot.first_part + part] = u32(made_->lights.size());
  made_->lights.push_back(base);
  made_->lights.back().part = part;
  powers_.push_back(M_PI * area * radiosity);
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
  const Box& bounds = placement_.bounds;
  const double radius = bounds.empty() ? 1 : 0.5 * double(glm::length(bounds.upper - bounds.lower));
  return M_PI * radius * radius * luminance(integral * view.radiance);
}

void Lighter::distribute(double dome_power) {
  double total = 0;
  for (const double p : powers_) total += p;
  const double least =
      total > 0 ? kSmallestShare * total / double(powers_.size()) : 1;  // all too dim for a double
  double sum = 0;
  for (double& p : powers_) sum += p = std::max(p, least);
  double dome = 0;
  if (dome_power > 0) {
    dome = sum > 0 ? std::clamp(dome_power / (dome_power + sum), kSmallestDomeShare,
                                1 - kSmallestDomeShare)
                   : 1;
  }
  made_->dome.probability = float(dome);
  const float all = 1 - made_->dome.probability;
  double running = 0;
  float before = 0;
  for (std::size_t i = 0; i < powers_.size(); ++i) {
    running += powers_[i];
    const float now = i + 1 == powers_.size() ? all : float(running / sum * double(all));
    made_->cdf.push_back(now);
    made_->lights[i].probability = now - before;
    before = now;
  }
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
  if (light.unit == LightUnit::kLuminance || light.unit == LightUnit::kLumen)
    scale /= kLumensPerWatt;
  if (light.unit == LightUnit::kPower || light.unit == LightUnit::kLumen)
    scale = area > 0 ? scale / (M_PI * area) : 0;
  const vec3 tint = light.temperature > 0 ? planckian_color(double(light.temperature)) : vec3(1);
  return light.color * tint * float(scale);
}

std::shared_ptr<const Lights> make_lights(const Snapshot& snapshot, const Placement& placement,
                                          const Materials& materials, const MeshBuilder& builder,
                                          DerivedCache& cache) {
  return Lighter(snapshot, placement, materials, builder, cache).make();
}

}  // namespace heliograph::embree
