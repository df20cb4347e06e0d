// Defaults of components. Called wherever a material is made.
#include "renderer/scene/components.h"

namespace heliograph {

Material make_material() {
  Material material;
#define HELIO_DEFAULT(name, components, default_value, ...) \
  material[MaterialParameter::name].value = vec3(default_value);
  HELIO_MATERIAL_PARAMETERS(HELIO_DEFAULT)
#undef HELIO_DEFAULT
  return material;
}

}  // namespace heliograph
