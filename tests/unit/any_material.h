// Materials at random, for tests of what holds for all of them.
#pragma once

#include "tests/unit/random.h"
#include "tests/unit/test_scene.h"

namespace heliograph::test {

/// A material of many lobes: each is there or not, with any weight and roughness.
inline MaterialView any_material(Random& random) {
  MaterialView m = standard_material();
  MaterialValues& v = m.constant;
  const auto some = [&](float chance) { return random.next() < chance ? random.next() : 0; };
  const auto color = [&] { return vec3(random.next(), random.next(), random.next()); };
  v.base_color = color();
  v.roughness = some(0.8f);
  v.specular = some(0.8f);
  v.specular_tint = some(0.3f);
  v.specular_color = color();
  v.ior = 1.1f + random.next();
  v.metallic = some(0.4f);
  v.transmission = some(0.5f);
  v.transmission_roughness = some(0.4f);
  v.anisotropic = some(0.3f);
  v.clearcoat = some(0.3f);
  v.clearcoat_roughness = some(0.7f);
  v.sheen = some(0.3f);
  v.sheen_color = color();
  v.sheen_roughness = random.next();
  v.sheen_tint = some(0.5f);
  v.iridescence = some(0.3f);
  v.iridescence_thickness = 800 * some(0.8f);
  v.subsurface = some(0.3f);
  v.subsurface_color = color();
  v.subsurface_radius = 0.2f * color();
  v.diffuse_transmission = some(0.3f);
  v.diffuse_transmission_color = color();
  v.dispersion = some(0.2f);
  m.thin_walled = random.next() < 0.2f;
  return m;
}

}  // namespace heliograph::test
