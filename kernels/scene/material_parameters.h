// The only lists of material parameters, X(name, components, default, smallest, largest), in the
// order of the bits in MaterialView::textured, of those that are lobes, and of textures that shape
// the normal, X(name).
#pragma once

#define HELIO_MATERIAL_PARAMETERS(X)        \
  X(base_color, 3, 0.8f, 0, 1)              \
  X(metallic, 1, 0, 0, 1)                   \
  X(roughness, 1, 0.5f, 0, 1)               \
  X(specular, 1, 1, 0, 1)                   \
  X(specular_color, 3, 1, 0, 1e4f)          \
  X(ior, 1, 1.5f, 1, 4)                     \
  X(transmission, 1, 0, 0, 1)               \
  X(emission, 3, 0, 0, 1e9f)                \
  X(emission_strength, 1, 1, 0, 1e9f)       \
  X(alpha, 1, 1, 0, 1)                      \
  X(subsurface, 1, 0, 0, 1)                 \
  X(subsurface_radius, 3, 0.01f, 0, 1e4f)   \
  X(subsurface_color, 3, 0.8f, 0, 1)        \
  X(attenuation_color, 3, 1, 0, 1)          \
  X(attenuation_distance, 1, 0, 0, 1e9f)    \
  X(specular_tint, 1, 0, 0, 1)              \
  X(transmission_roughness, 1, 0, 0, 1)     \
  X(anisotropic, 1, 0, 0, 1)                \
  X(anisotropic_rotation, 1, 0, 0, 1)       \
  X(sheen, 1, 0, 0, 1)                      \
  X(sheen_color, 3, 1, 0, 1)                \
  X(sheen_roughness, 1, 0.5f, 0, 1)         \
  X(sheen_tint, 1, 0, 0, 1)                 \
  X(clearcoat, 1, 0, 0, 1)                  \
  X(clearcoat_roughness, 1, 0.03f, 0, 1)    \
  X(medium_density, 3, 0, 0, 1e6f)          \
  X(medium_albedo, 3, 1, 0, 1)              \
  X(medium_anisotropy, 1, 0, -0.99f, 0.99f) \
  X(iridescence, 1, 0, 0, 1)                \
  X(iridescence_ior, 1, 1.3f, 1, 4)         \
  X(iridescence_thickness, 1, 400, 0, 1e4f) \
  X(diffuse_transmission, 1, 0, 0, 1)       \
  X(diffuse_transmission_color, 3, 1, 0, 1) \
  X(dispersion, 1, 0, 0, 100)

/// Lobes beyond a coat over a diffuse body, a metal and glass: a material has one where its
/// parameter is above 0, and is Features::kAll then.
#define HELIO_LOBES(X) \
  X(subsurface)        \
  X(anisotropic)       \
  X(sheen)             \
  X(clearcoat)         \
  X(iridescence)       \
  X(diffuse_transmission)

/// All that such materials read at a point beside what others do.
#define HELIO_LOBE_PARAMETERS(X) \
  HELIO_LOBES(X)                 \
  X(transmission)                \
  X(transmission_roughness)      \
  X(subsurface_radius)           \
  X(subsurface_color)            \
  X(sheen_color)                 \
  X(sheen_roughness)             \
  X(sheen_tint)                  \
  X(clearcoat_roughness)         \
  X(iridescence_ior)             \
  X(iridescence_thickness)       \
  X(diffuse_transmission_color)

#define HELIO_NORMAL_MAPS(X) \
  X(normal_map)              \
  X(bump_map)                \
  X(clearcoat_normal_map)
