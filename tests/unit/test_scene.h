// Scenes of a few meshes as kernels see them. Included by test_tracer.h.
#pragma once

#include <algorithm>
#include <cstring>
#include <deque>
#include <functional>
#include <numeric>
#include <vector>

#include "kernels/geometry/accept.h"
#include "kernels/integrator/path.h"
#include "kernels/label/probe.h"
#include "kernels/light/light_flat.h"
#include "tests/unit/test_meshes.h"

namespace heliograph::test {

using namespace heliograph::kernels;

inline TextureUseView no_texture() { return {kNone, 0, 0, 1, 0, {1, 0}, {0, 1}, {0, 0}}; }

inline MaterialView standard_material() {
  MaterialView m{};
#define HELIO_PARAMETER(name, components, standard, ...) \
  m.constant.name = ParameterType<components>::type(standard);
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
#define HELIO_MAP(name) m.name = no_texture();
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  m.alpha_cutoff = 0.5f;
  return m;
}
inline MaterialView lambert(vec3 color) {
  MaterialView m = standard_material();
  m.constant.base_color = color;
  m.constant.specular = 0;
  return m;
}
inline MaterialView emitter(vec3 radiance) {
  MaterialView m = lambert(vec3(0));
  m.constant.emission = radiance;
  return m;
}

inline mat4x3 pose(mat3 linear, vec3 translation) {
  return mat4x3(linear[0], linear[1], linear[2], translation);
}
inline mat4x3 inverse(const mat4x3& m) {
  const mat3 linear = glm::inverse(mat3(m[0], m[1], m[2]));
  return pose(linear, -(linear * m[3]));
}
inline mat3 rotation(vec3 axis, float angle) {
  const vec3 a = normalize(axis);
  const mat3 k(0, a.z, -a.y, -a.z, 0, a.x, a.y, -a.x, 0);
  return mat3(1) + k * std::sin(angle) + k * k * (1 - std::cos(angle));
}

/// A camera at `eye` that looks at `target`, square pixels of `fov` radians over the width.
inline CameraView look_at(vec3 eye, vec3 target, uvec2 size, float fov) {
  const vec3 back = normalize(eye - target);
  const vec3 up = std::fabs(back.z) < 0.99f ? vec3(0, 0, 1) : vec3(0, 1, 0);
  const vec3 right = normalize(cross(up, back));
  CameraView c{};
  c.world_from_camera = pose(mat3(right, cross(back, right), back), eye);
  c.camera_from_world = inverse(c.world_from_camera);
  c.fx = c.fy = 0.5f * float(size.x) / std::tan(0.5f * fov);
  c.cx = 0.5f * float(size.x);
  c.cy = 0.5f * float(size.y);
  c.width = size.x;
  c.height = size.y;
  return c;
}

/// Owns what a SceneView points to. Add things, then call finish() once.
class TestScene {
 public:
  u32 add(MaterialView material) {
    material.id = u32(materials.size());
    material.passable = is_passable(material);
    materials.push_back(material);
    return material.id;
  }
  u32 add(TestMesh mesh) {
    meshes_.push_back(std::move(mesh));
    return u32(meshes_.size() - 1);
  }
  template <class Texel>
  u32 add_texture(std::vector<Texel> texels, uvec2 size, TexelType type) {
    auto& bytes = texels_.emplace_back(texels.size() * sizeof(Texel));
    std::memcpy(bytes.data(), texels.data(), bytes.size());
    const u32 channels = u32(texels.size() / (size_t(size.x) * size.y));
    textures.push_back({.texels = bytes.data(),
                        .width = size.x,
                        .height = size.y,
                        .channels = u8(channels),
                        .type = type,
                        .wrap_u = Wrap::kRepeat,
                        .wrap_v = Wrap::kRepeat});
    return u32(textures.size() - 1);
  }
  /// Binds `material` to every part. Returns the instance.
  u32 add_instance(u32 mesh, const std::vector<u32>& part_materials, mat4x3 world_from_object) {
    InstanceView i{};
    i.world_from_object = world_from_object;
    i.object_from_world = inverse(world_from_object);
    i.mesh = mesh;
    i.first_part = u32(part_materials_.size());
    const mat3 linear(world_from_object[0], world_from_object[1], world_from_object[2]);
    if (determinant(linear) < 0) i.flags |= kFlipped;
    for (u32 m : part_materials) {
      if (materials[m].alpha_mode != AlphaMode::kOpaque) i.flags |= kMayBeHole;
      part_materials_.push_back(m);
      part_lights_.push_back(kNone);
    }
    i.visibility = kAllRays;
    i.entity = i.label = u32(instances.size() + 1);
    rest_boxes.push_back({mat4x3(1), vec3(1)});
    instances.push_back(i);
    return u32(instances.size() - 1);
  }
  u32 add_instance(u32 mesh, u32 material, mat4x3 world_from_object = mat4x3(1)) {
    return add_instance(mesh, std::vector<u32>{material}, world_from_object);
  }
  /// Makes a part of an instance a light that sample_light() knows.
  LightView& add_light(u32 instance, u32 part = 0, vec3 radiance = vec3(0)) {
    const MaterialView& m = materials[part_materials_[instances[instance].first_part + part]];
    LightView light{};
    light.radiance = radiance;
    light.texture = no_texture();
    light.instance = instance;
    light.part = part;
    light.material_emits = !is_black(m.constant.emission);
    light.material_two_sided = m.two_sided_emission;
    part_lights_[instances[instance].first_part + part] = u32(lights.size());
    return lights.emplace_back(light);
  }
  void set_dome(vec3 radiance, u32 texture = kNone) {
    view.dome.radiance = radiance;
    view.dome.texture = texture;
    has_dome_ = true;
  }
  /// Builds all tables and trees.
  const SceneView& finish() {
    for (const TestMesh& mesh : meshes_) mesh_views_.push_back(make_view(mesh));
    for (LightView& light : lights) light_bounds.push_back(add_tree(light));
    for (LightView& light : lights) {
      const InstanceView& instance = instances[light.instance];
      detect_sphere(light, instance, meshes_[instance.mesh].shape);
    }
    for (LightView& light : lights) {
      const InstanceView& instance = instances[light.instance];
      add_flat_triangles(light, instance, mesh_views_[instance.mesh], flat_triangles_);
    }
    view.flat_triangles = flat_triangles_.data();
    view.only_even = std::ranges::all_of(lights, [](const LightView& light) {
      return light.sphere_radius > 0 || light.flat != kNone;
    });
    light_nodes_ = make_tree(light_bounds, 1);
    for (u32 i = 0; i < light_nodes_.size(); ++i)
      if (light_nodes_[i].count > 0) lights[light_nodes_[i].first].leaf = i;
    DomeView& dome = view.dome;
    const float kinds = float(suns.size() + (has_dome_ ? 1 : 0));
    dome.probability = has_dome_ ? 1 / kinds : 0;
    for (SunView& sun : suns) sun.probability = 1 / kinds;
    view.sky_power = kinds;
    view.suns = suns.data();
    view.sun_count = u32(suns.size());
    if (!has_dome_) dome.texture = kNone;
    dome.world_from_dome = dome_rotation;
    dome.dome_from_world = transpose(dome_rotation);
    dome.camera_visible = true;
    if (dome.texture != kNone) make_dome_tables();
    view.instances = instances.data();
    view.meshes = mesh_views_.data();
    view.materials = materials.data();
    view.textures = textures.data();
    view.texture_uses = texture_uses.data();
    view.part_materials = part_materials_.data();
    view.part_lights = part_lights_.data();
    view.lights = lights.data();
    view.light_nodes = light_nodes_.data();
    view.instance_count = u32(instances.size());
    view.light_count = u32(lights.size());
    for (const InstanceView& i : instances) view.any_holes |= (i.flags & kMayBeHole) != 0;
    for (const u32 m : part_materials_) accumulate_features(view, materials[m]);
    return view;
  }

  SceneView view{};
  std::vector<InstanceView> instances;
  std::vector<RestBoxView> rest_boxes;
  std::vector<MaterialView> materials;
  std::vector<TextureView> textures;
  std::vector<TextureUseView> texture_uses;
  std::vector<LightView> lights;
  std::vector<SunView> suns;
  std::vector<LightBounds> light_bounds;  // in the world; made by finish()
  mat3 dome_rotation{1};
  std::function<float(u32)> triangle_radiosity;  // relative, by triangle; unset: 1

 private:
  struct Tree {
    std::vector<LightNode> nodes;
    std::vector<TriangleEntry> entries;
    std::vector<u32> entry_of_triangle;
  };
  /// A tree that halves the elements in their order.
  static std::vector<LightNode> make_tree(const std::vector<LightBounds>& elements, u32 leaf) {
    std::vector<LightNode> nodes;
    const auto build = [&](auto& self, u32 node, u32 begin, u32 end) -> LightBounds {
      LightBounds bounds = elements[begin];
      u32 first = begin, count = end - begin;
      if (count <= leaf) {
        for (u32 i = begin + 1; i < end; ++i) bounds = merge(bounds, elements[i]);
      } else {
        first = u32(nodes.size());
        nodes.resize(first + 2);
        const u32 middle = begin + count / 2;
        bounds = merge(self(self, first, begin, middle), self(self, first + 1, middle, end));
        nodes[first].parent = nodes[first + 1].parent = node;
        count = 0;
      }
      const u32 parent = node > 0 ? nodes[node].parent : kNone;
      nodes[node] = node_of(bounds);
      nodes[node].parent = parent;
      nodes[node].first = first;
      nodes[node].count = u16(count);
      return bounds;
    };
    if (elements.empty()) return nodes;
    nodes.resize(1);
    build(build, 0, 0, u32(elements.size()));
    return nodes;
  }
  /// Bounds of a disc or a sphere in the world.
  static LightBounds shape_bounds(const LightView& light, const InstanceView& instance, Shape s) {
    const mat4x3& m = instance.world_from_object;
    const vec3 extent = abs3(m[0]) + abs3(m[1]) + (s == Shape::kSphere ? abs3(m[2]) : vec3(0));
    LightBounds world{.lower = m[3] - extent, .upper = m[3] + extent};
    world.axis = -normalize(transform_normal(instance.object_from_world, vec3(0, 0, 1)));
    world.cos_spread = s == Shape::kDisc || light.cone_scale > 0 ? 1 : -1;
    world.power = length(cross(m[0], m[1]));
    world.two_sided = emits_back(light);
    return world;
  }
  /// The light's tree over its triangles; returns its bounds in the world.
  LightBounds add_tree(LightView& light) {
    const InstanceView& instance = instances[light.instance];
    const MeshView& mesh = mesh_views_[instance.mesh];
    if (mesh.shape != Shape::kTriangles) return shape_bounds(light, instance, mesh.shape);
    Tree& tree = trees_.emplace_back();
    tree.entry_of_triangle.resize(mesh.triangle_count);
    std::vector<LightBounds> elements;
    LightBounds world;
    const auto corner = [&](u32 v) {
      return transform_point(instance.world_from_object, mesh.positions[v]);
    };
    for (u32 i = 0; i < mesh.triangle_count; ++i) {
      if (part_of(mesh, i) != light.part) continue;
      const uvec3 t = mesh.triangles[i];
      elements.push_back(
          triangle_bounds(mesh.positions[t.x], mesh.positions[t.y], mesh.positions[t.z]));
      tree.entry_of_triangle[i] = u32(tree.entries.size());
      const float radiosity = triangle_radiosity ? triangle_radiosity(i) : 1;
      elements.back().power *= radiosity;
      tree.entries.push_back({i, radiosity, elements.back().power, 0});
      LightBounds own = triangle_bounds(corner(t.x), corner(t.y), corner(t.z));
      if (instance.flags & kFlipped) own.axis = -own.axis;
      world = elements.size() == 1 ? own : merge(world, own);
    }
    tree.nodes = make_tree(elements, kLeafTriangles);
    for (u32 n = 0; n < tree.nodes.size(); ++n)
      for (u32 i = 0; i < tree.nodes[n].count; ++i) tree.entries[tree.nodes[n].first + i].leaf = n;
    light.tree = {tree.nodes.data(), tree.entries.data(), tree.entry_of_triangle.data(), 0};
    world.two_sided = emits_back(light);
    return world;
  }
  MeshView make_view(const TestMesh& m) {
    const auto data = [](const auto& v) { return v.empty() ? nullptr : v.data(); };
    MeshView v{};
    v.triangles = m.triangles.data();
    v.positions = v.rest_positions = m.positions.data();
    v.normals = data(m.normals);
    v.uvs = data(m.uvs);
    v.colors = data(m.colors);
    v.tangents = data(m.tangents);
    v.parts = data(m.parts);
    v.triangle_count = u32(m.triangles.size());
    v.vertex_count = u32(m.positions.size());
    v.shape = m.shape;
    v.strand_points = data(m.strand_points);
    v.uvs_around = m.shape == Shape::kCurves && v.uvs;
    v.part_count = m.parts.empty() ? 1 : *std::max_element(m.parts.begin(), m.parts.end()) + 1;
    return v;
  }
  void make_dome_tables() {
    const TextureView& t = textures[view.dome.texture];
    row_cdf_.assign(t.height, 0);
    column_cdf_.assign(size_t(t.width) * t.height, 0);
    double total = 0;
    for (u32 y = 0; y < t.height; ++y) {
      double row = 0;
      for (u32 x = 0; x < t.width; ++x) {
        // A little everywhere: bilinear lookup spreads light to dark neighbours.
        row += luminance(vec3(as_radiance(load_rgba(t, u64(y) * t.width + x)))) + 1e-2;
        column_cdf_[size_t(y) * t.width + x] = float(row);
      }
      for (u32 x = 0; x < t.width; ++x) column_cdf_[size_t(y) * t.width + x] /= float(row);
      total += row * std::sin(M_PI * (y + 0.5) / t.height);
      row_cdf_[y] = float(total);
    }
    for (float& r : row_cdf_) r /= float(total);
    view.dome.width = t.width;
    view.dome.height = t.height;
    view.dome.row_cdf = row_cdf_.data();
    view.dome.column_cdf = column_cdf_.data();
    const auto add_guide = [this](const float* cdf, u32 count) {
      for (u32 i = 0; i < kDomeGuide; ++i)
        guides_.push_back(u16(choose(cdf, count, float(i) / kDomeGuide).index));
    };
    for (u32 y = 0; y < t.height; ++y) add_guide(column_cdf_.data() + size_t(y) * t.width, t.width);
    add_guide(row_cdf_.data(), t.height);
    view.dome.guides = guides_.data();
  }

  std::vector<TestMesh> meshes_;
  std::vector<MeshView> mesh_views_;
  std::vector<FlatTriangle> flat_triangles_;
  std::deque<Tree> trees_;
  std::vector<LightNode> light_nodes_;
  std::deque<std::vector<u8>> texels_;
  std::vector<u32> part_materials_, part_lights_;
  std::vector<float> row_cdf_, column_cdf_;
  std::vector<u16> guides_;
  bool has_dome_ = false;
};

}  // namespace heliograph::test
