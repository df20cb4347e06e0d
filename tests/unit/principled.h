// Materials with all parameters, seen from a direction. Their normal is z.
#pragma once

#include "kernels/bsdf/bsdf.h"

namespace heliograph::test {

using kernels::vec3;

inline const vec3 kUp(0, 0, 1);

inline kernels::MaterialValues standard() {
  using namespace kernels;
  MaterialValues m{};
#define HELIO_PARAMETER(name, components, standard, ...) \
  m.name = ParameterType<components>::type(standard);
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
  return m;
}

struct Config {
  const char* name;
  kernels::MaterialValues m;
  bool thin_walled = false;
};

inline vec3 direction_at(float cosine, bool front = true) {
  const float sine = std::sqrt(1 - cosine * cosine);
  return vec3(0.6f * sine, 0.8f * sine, front ? cosine : -cosine);
}

inline kernels::Bsdf bsdf_of(const Config& c, vec3 wo, vec3 clearcoat_normal = kUp) {
  return make_bsdf(c.m, {.wo = wo,
                         .ng = kUp,
                         .ns = kUp,
                         .tangent = vec3(0.8f, -0.6f, 0),
                         .clearcoat_normal = clearcoat_normal,
                         .thin_walled = c.thin_walled});
}

}  // namespace heliograph::test
