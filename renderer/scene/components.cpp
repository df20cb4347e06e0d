// Defaults of components, and the patches that make them. Called wherever a material is made, and
// by describe().
#include "renderer/scene/components.h"

#include "renderer/scene/transaction.h"

namespace heliograph {

Material make_material() {
  Material material;
#define HELIO_DEFAULT(name, components, default_value, ...) \
  material[MaterialParameter::name].value = vec3(default_value);
  HELIO_MATERIAL_PARAMETERS(HELIO_DEFAULT)
#undef HELIO_DEFAULT
  return material;
}

PutVolume describe(const Volume& volume) {
  return {.density = volume.density,
          .temperature = volume.temperature,
          .color = volume.color,
          .density_scale = volume.density_scale,
          .albedo = volume.albedo,
          .anisotropy = volume.anisotropy,
          .temperature_scale = volume.temperature_scale,
          .emission_scale = volume.emission_scale};
}

}  // namespace heliograph
