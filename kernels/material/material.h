// Material parameters at a point: constants times textures. Called by surface.h, accept.h, light.h.
#pragma once

#include "kernels/material/texture.h"

namespace heliograph::kernels::inline HELIO_ISA {

inline constexpr ParameterSet kEmissionBits =
    parameters(ParameterBit::emission, ParameterBit::emission_strength);
inline constexpr ParameterSet kAlphaBit = parameters(ParameterBit::alpha);

/// Texture coordinates of a point: both sets, zero where the mesh has none.
struct Uvs {
  vec2 set[2];
  float width[2] = {0, 0};  // of what is looked at, in each set; 0: a point
};

KERNEL vec2 interpolate(const vec2* values, uvec3 triangle, vec2 barycentric) {
  const vec2 a = values[triangle.x];
  return a + (values[triangle.y] - a) * barycentric.x + (values[triangle.z] - a) * barycentric.y;
}

/// True if a mesh has curves. Plain programs render none.
KERNEL bool has_curves(const MeshView& mesh) { return kRich && mesh.shape == Shape::kCurves; }

/// barycentric   as Surface has it
KERNEL Uvs uvs_at(const MeshView& mesh, uvec3 triangle, vec2 barycentric) {
  Uvs uvs{{mesh.uvs ? interpolate(mesh.uvs, triangle, barycentric) : vec2(0),
           mesh.uvs1 ? interpolate(mesh.uvs1, triangle, barycentric) : vec2(0)}};
  if (has_curves(mesh) && mesh.uvs_around) uvs.set[0].y += barycentric.y;
  return uvs;
}

KERNEL vec4 color_at(const MeshView& mesh, uvec3 triangle, vec2 barycentric) {
  const vec4 a = mesh.colors[triangle.x];
  return a + (mesh.colors[triangle.y] - a) * barycentric.x +
         (mesh.colors[triangle.z] - a) * barycentric.y;
}

/// A difference of texture coordinates as a use of a texture sees it.
KERNEL vec2 turn_uv(const TextureUseView& use, vec2 uv) {
  return use.uv_x * uv.x + use.uv_y * uv.y;
}

KERNEL vec2 transform_uv(const TextureUseView& use, const Uvs& uvs) {
  return turn_uv(use, uvs.set[use.uv_set & 1]) + use.uv_offset;
}

/// A texture's value over the width of what is looked at.
HELIO_GPU_NOINLINE KERNEL vec4 filter_use(const SceneView& scene, const TextureUseView& use,
                                          const Uvs& uvs) {
  const TextureView& texture = scene.textures[use.texture];
  const float scale = std::sqrt(std::fabs(use.uv_x.x * use.uv_y.y - use.uv_x.y * use.uv_y.x));
  const float texels =
      uvs.width[use.uv_set & 1] * scale * float(min2(texture.width, texture.height));
  return sample_texture(level_of(texture, texels), transform_uv(use, uvs)) * use.scale + use.offset;
}

template <bool kRadiance = false>
HELIO_GPU_NOINLINE KERNEL vec4 sample_use(const SceneView& scene, const TextureUseView& use,
                                          const Uvs& uvs) {
  const vec4 texel = sample_texture<kRadiance>(scene.textures[use.texture], transform_uv(use, uvs));
  return texel * use.scale + use.offset;
}

/// A texture's factor to a constant.
KERNEL void multiply(vec3& value, vec4 texel, u32) { value *= vec3(texel); }
KERNEL void multiply(float& value, vec4 texel, u32 channel) { value *= texel[i32(channel)]; }

KERNEL float clamp_to(float x, float smallest, float largest) {
  return x > smallest ? min2(x, largest) : smallest;
}
KERNEL vec3 clamp_to(vec3 v, float smallest, float largest) {
  return vec3(clamp_to(v.x, smallest, largest), clamp_to(v.y, smallest, largest),
              clamp_to(v.z, smallest, largest));
}

/// The parameters named by the bits of `wanted`, textures applied and clamped to their ranges; the
/// others keep their constants. Emission and alpha are those of the point: lights and holes are
/// sampled so.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL MaterialValues evaluate_material(
    const SceneView& scene, const MaterialView& material, const Uvs& uvs, ParameterSet wanted) {
  MaterialValues values = material.constant;
  if ((material.textured & wanted) == 0) return values;
  u32 use = material.first_use;
  for (ParameterSet left = material.textured; left != 0; left &= left - 1) {
    const u32 i = lowest_bit(left);
    const TextureUseView& view = scene.texture_uses[use++];
    if (!(wanted >> i & 1)) continue;
    const bool at_point = (kEmissionBits | kAlphaBit) >> i & 1;
    const vec4 texel = at_point ? sample_use(scene, view, uvs) : filter_use(scene, view, uvs);
    switch (ParameterBit(i)) {
#define HELIO_PARAMETER(name, components, standard, smallest, largest) \
  case ParameterBit::name:                                             \
    multiply(values.name, texel, view.channel);                        \
    values.name = clamp_to(values.name, smallest, largest);            \
    break;
      HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
      case ParameterBit::kCount:
        break;
    }
  }
  return values;
}

/// True if there may be a medium inside surfaces of a material.
KERNEL bool may_fill(const MaterialView& material) {
  const MaterialValues& m = material.constant;
  return !material.thin_walled && (m.transmission > 0 || m.diffuse_transmission > 0) &&
         (m.attenuation_distance > 0 || !is_black(m.medium_density));
}

/// True if a material is the boundary of a medium and nothing else: of index 1, smooth and clear.
/// Light passes it straight on, also on its way from a light.
KERNEL bool is_passable(const MaterialView& material) {
  constexpr ParameterSet kDecisive =
      parameters(ParameterBit::ior, ParameterBit::roughness, ParameterBit::transmission,
                 ParameterBit::transmission_roughness);
  const MaterialValues& m = material.constant;
  return !material.thin_walled && !material.unlit && (material.textured & kDecisive) == 0 &&
         m.ior == 1 && m.roughness == 0 && m.transmission == 1 && m.transmission_roughness == 0 &&
         m.metallic == 0 && m.sheen == 0 && m.clearcoat == 0 && m.iridescence == 0;
}

/// True if light can enter a body behind surfaces of a material. A sheet of paper that nobody
/// called thin-walled has none.
KERNEL bool is_body(const MaterialView& material) {
  return !material.thin_walled && !material.unlit &&
         (material.constant.transmission > 0 || may_fill(material));
}

/// Microfacets with less than this alpha are a perfect mirror.
inline constexpr float kDeltaAlpha = 1e-3f;

/// Features that surfaces may have, each with all before it.
enum class Features : u8 {
  kOpaque,  // coat and metal under microfacets
  kGlass,   // perfect mirrors, and glass whose microfacets reflect or refract
  kAll      // layers, films, bodies, stretched highlights, dispersion, what light passes apart
};
KERNEL Features features_of(const MaterialValues& m, bool thin_walled) {
  const bool apart = m.transmission > 0 && (thin_walled || m.transmission_roughness > 0);
  const bool disperses = m.transmission > 0 && m.dispersion > 0;
#define HELIO_HAS(name) || m.name > 0
  if (apart || disperses HELIO_LOBES(HELIO_HAS)) return Features::kAll;
#undef HELIO_HAS
  const bool mirror = (m.specular > 0 || m.metallic > 0) && sqr(m.roughness) < kDeltaAlpha;
  return m.transmission > 0 || mirror ? Features::kGlass : Features::kOpaque;
}

/// True if surfaces of a material scatter light as plain programs do not, see kRich. Textures scale
/// what the constants are.
KERNEL bool is_rich(const MaterialView& material) {
  return features_of(material.constant, material.thin_walled) == Features::kAll;
}

/// Counts the material of an instance in SceneView's totals of all.
KERNEL void accumulate_features(SceneView& scene, const MaterialView& material) {
  scene.any_rich |= is_rich(material);
  scene.any_unlit |= material.unlit;
  scene.any_priority |= material.priority != 0;
  scene.any_passable |= material.passable;
  scene.any_media |= material.priority != 0 || material.passable || may_fill(material);
}

KERNEL const MaterialView& material_of(const SceneView& scene, const InstanceView& instance,
                                       u32 mesh_part) {
  return scene.materials[scene.part_materials[instance.first_part + mesh_part]];
}

KERNEL u32 part_of(const MeshView& mesh, u32 primitive) {
  return mesh.parts ? mesh.parts[primitive] : 0;
}

/// Share of rays that meet the surface at a point: 0 or 1 unless the material blends.
HELIO_GPU_NOINLINE KERNEL float opacity_at(const SceneView& scene, u32 instance_index,
                                           u32 primitive, vec2 barycentric) {
  const InstanceView& instance = scene.instances[instance_index];
  const MeshView& mesh = scene.meshes[instance.mesh];
  const MaterialView& material = material_of(scene, instance, part_of(mesh, primitive));
  if (material.alpha_mode == AlphaMode::kOpaque) return 1;
  const uvec3 triangle = mesh.triangles[primitive];
  if (has_curves(mesh)) barycentric.x = clamp01(barycentric.x);
  float alpha = material.constant.alpha;
  if (material.textured & kAlphaBit) {
    const Uvs uvs = uvs_at(mesh, triangle, barycentric);
    alpha = evaluate_material(scene, material, uvs, kAlphaBit).alpha;
  }
  if (mesh.colors) alpha *= color_at(mesh, triangle, barycentric).w;
  if (material.alpha_mode == AlphaMode::kMask) return alpha < material.alpha_cutoff ? 0 : 1;
  return alpha;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
