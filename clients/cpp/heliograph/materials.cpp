// Parameters, and the bundled materials; sources of the numbers:
// clients/python/heliograph/values/materials.py.
#include "heliograph/material.h"

#include <utility>

namespace heliograph::client {
namespace {

template <class T>
void add(std::vector<std::pair<std::string, Parameters::Value>>& values, const std::string& name,
         const T& value) {
  values.emplace_back(name, Parameters::Value(value));
}

}  // namespace

Parameters& Parameters::set(const std::string& name, const ScalarParameter& value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, const ColorParameter& value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, const TextureUse& value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, bool value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, double value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, std::int32_t value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::set(const std::string& name, AlphaMode value) {
  return add(values_, name, value), *this;
}
Parameters& Parameters::reset(const std::string& name) {
  return add(values_, name, std::monostate()), *this;
}

namespace materials {

Parameters matte() { return Parameters().base_color(0.6).roughness(1).specular(0); }
Parameters plaster() { return Parameters().base_color({0.78, 0.76, 0.72}).roughness(0.9); }
Parameters plastic() { return Parameters().base_color({0.05, 0.2, 0.6}).roughness(0.25); }
Parameters rubber() { return Parameters().base_color(0.03).roughness(0.75); }
Parameters wood() { return Parameters().base_color({0.38, 0.22, 0.12}).roughness(0.55); }
Parameters steel() {
  return Parameters().base_color({0.56, 0.57, 0.58}).metallic(1).roughness(0.25);
}
Parameters aluminium() {
  return Parameters().base_color({0.91, 0.92, 0.92}).metallic(1).roughness(0.3);
}
Parameters gold() { return Parameters().base_color({1.0, 0.77, 0.34}).metallic(1).roughness(0.15); }
Parameters copper() {
  return Parameters().base_color({0.95, 0.64, 0.54}).metallic(1).roughness(0.2);
}
Parameters chrome() {
  return Parameters().base_color({0.55, 0.55, 0.55}).metallic(1).roughness(0.03);
}
Parameters glass() { return Parameters().base_color(1).transmission(1).roughness(0).ior(1.5); }
Parameters frosted_glass() { return Parameters().base_color(1).transmission(1).roughness(0.35); }
Parameters marble() {
  return Parameters()
      .subsurface(1)
      .subsurface_color({0.83, 0.79, 0.75})
      .subsurface_radius({0.46e-3, 0.38e-3, 0.33e-3})
      .roughness(0.3);
}
Parameters skin() {
  return Parameters()
      .subsurface(1)
      .subsurface_color({0.44, 0.22, 0.13})
      .subsurface_radius({1.3e-3, 0.95e-3, 0.67e-3})
      .ior(1.3)
      .roughness(0.45);
}
Parameters milk() {
  return Parameters()
      .subsurface(1)
      .subsurface_color({0.91, 0.88, 0.76})
      .subsurface_radius({0.39e-3, 0.31e-3, 0.26e-3})
      .ior(1.3)
      .roughness(0);
}

}  // namespace materials
}  // namespace heliograph::client
