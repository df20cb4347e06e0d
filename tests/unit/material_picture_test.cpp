// Materials through apply() and the backend: each parameter changes the picture, and a constant is
// the same as a texture of that value.
#include "renderer/schedule/engine.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using enum MaterialParameter;

namespace {

struct Row {
  MaterialParameter parameter;
  const char* name;
  bool scalar;
};
constexpr Row kRows[] = {
#define HELIO_PARAMETER(name, components, ...) {name, #name, components == 1},
    HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
};

/// A material in which each parameter counts.
PutMaterial everything() {
  PutMaterial m;
  const auto set = [&](MaterialParameter p, vec3 v) { m.parameters[std::size_t(p)].value = v; };
  set(base_color, {0.8f, 0.4f, 0.2f});
  set(roughness, vec3(0.4f));
  set(metallic, vec3(0.2f));
  set(transmission, vec3(0.3f));
  set(transmission_roughness, vec3(0.1f));
  set(specular_tint, vec3(0.3f));
  set(anisotropic, vec3(0.5f));
  set(anisotropic_rotation, vec3(0.1f));
  set(sheen, vec3(0.4f));
  set(sheen_tint, vec3(0.2f));
  set(clearcoat, vec3(0.4f));
  set(clearcoat_roughness, vec3(0.2f));
  set(emission, vec3(0.1f));
  set(alpha, vec3(0.9f));
  set(subsurface, vec3(0.5f));
  set(subsurface_radius, {0.5f, 0.3f, 0.2f});
  set(subsurface_color, {0.4f, 0.8f, 0.9f});
  set(attenuation_color, {0.5f, 0.7f, 0.9f});
  set(attenuation_distance, vec3(0.7f));
  set(medium_density, {2, 3, 2.5f});
  set(medium_albedo, {0.9f, 0.8f, 0.7f});
  set(medium_anisotropy, vec3(0.6f));
  set(iridescence, vec3(0.8f));
  set(iridescence_ior, vec3(1.8f));
  set(iridescence_thickness, vec3(300));
  set(diffuse_transmission, vec3(0.4f));
  set(diffuse_transmission_color, {0.3f, 0.9f, 0.6f});
  set(dispersion, vec3(2));
  m.alpha_mode = AlphaMode::kBlend;
  return m;
}

/// A ball of a material; inner: of a smaller ball within.
std::vector<float> picture(const PutMaterial& material, const PutTexture* texture = nullptr,
                           const PutMaterial* inner = nullptr) {
  auto engine = make_engine();
  Light light;
  light.intensity = 20;
  Edits edits;
  if (texture) edits.put("texture", *texture);
  edits.mesh("sphere", sphere(16))
      .mesh("quad", quad())
      .put("material", material)
      .object("ball", "sphere", mat4x3(1), "material");
  if (inner)
    edits.put("inner", *inner)
        .object("core", "sphere", mat4x3(0.5f, 0, 0, 0, 0.5f, 0, 0, 0, 0.5f, 0, 0, 0), "inner");
  edits.object("lamp", "quad", mat4x3(1, 0, 0, 0, -1, 0, 0, 0, -1, 0.5f, 0, 3))
      .light("lamp", light)
      .dome(vec3(0.3f, 0.4f, 0.5f))
      .camera("camera", look_at({3, -3, 2}, vec3(0)), 16, 16, 24);
  RenderJob job = job_of(edits.apply(), {Plane::BEAUTY}, 8);
  job.settings.roulette_depth = kernels::kNone;  // what is deep in the ball shows in few paths
  const auto frame = render(*engine, job);
  const auto all = pixels<float>(*frame);
  return {all.begin(), all.end()};
}

/// A picture of one texel, which reads the same through every channel.
PutTexture texel(vec3 value) {
  const auto texels = ArrayOf<float>(std::vector<float>{value.x, value.y, value.z});
  return {.image = std::make_shared<const ImageData>(ImageData{.texels = texels.buffer(),
                                                               .width = 1,
                                                               .height = 1,
                                                               .channels = 3,
                                                               .type = TexelType::kF32}),
          .srgb = false};
}

float difference(const std::vector<float>& a, const std::vector<float>& b) {
  float sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += std::fabs(a[i] - b[i]);
  return sum / float(a.size());
}

}  // namespace

TEST_CASE("material: each parameter changes the picture") {
  const auto before = picture(everything());
  for (const Row& row : kRows) {
    PutMaterial m = everything();
    const vec3 value = m.parameters[std::size_t(row.parameter)].value.value_or(
        make_material()[row.parameter].value);
    m.parameters[std::size_t(row.parameter)].value = row.parameter == ior ? vec3(1.8f)
                                                     : row.parameter == iridescence_ior
                                                         ? vec3(1.4f)
                                                         : value * 0.5f;
    INFO(row.name);
    CHECK(difference(before, picture(m)) > 1e-5f);
  }
  PutMaterial thin = everything();
  thin.thin_walled = true;
  CHECK(difference(before, picture(thin)) > 1e-5f);
}

TEST_CASE("material: a constant is a texture of one texel with that value") {
  const auto before = picture(everything());
  for (const Row& row : kRows) {
    PutMaterial m = everything();
    ParameterPatch& parameter = m.parameters[std::size_t(row.parameter)];
    const vec3 value = parameter.value.value_or(make_material()[row.parameter].value);
    const PutTexture texture = texel(row.scalar ? vec3(0, value.x, 0) : value);
    parameter.value = vec3(1);
    parameter.texture = TextureUsePatch{.texture = "texture", .use = {}};
    parameter.texture->use.channel = row.scalar ? 1 : 0;
    INFO(row.name);
    CHECK(difference(before, picture(m, &texture)) < 1e-6f);
  }
}

TEST_CASE("material: a channel, a scale and an offset") {
  PutMaterial constant = everything();
  constant.parameters[std::size_t(clearcoat)].value = vec3(0.35f);
  PutMaterial textured = everything();
  ParameterPatch& parameter = textured.parameters[std::size_t(clearcoat)];
  parameter.value = vec3(0.5f);
  parameter.texture = TextureUsePatch{.texture = "texture", .use = {}};
  parameter.texture->use.channel = 2;
  parameter.texture->use.scale = 2;
  parameter.texture->use.offset = 0.1f;
  const PutTexture texture = texel({0.9f, 0.8f, 0.3f});
  CHECK(difference(picture(constant), picture(textured, &texture)) < 1e-6f);
}

TEST_CASE("material: of bodies that overlap the one of the highest priority is there") {
  const auto glass = [](float index, i32 priority) {
    PutMaterial m;
    m.parameters[std::size_t(base_color)].value = vec3(1);
    m.parameters[std::size_t(roughness)].value = vec3(0);
    m.parameters[std::size_t(transmission)].value = vec3(1);
    m.parameters[std::size_t(ior)].value = vec3(index);
    m.priority = priority;
    return m;
  };
  const PutMaterial outer = glass(1.5f, 1), below = glass(1.8f, 0), above = glass(1.8f, 2);
  const auto alone = picture(outer);
  CHECK(difference(alone, picture(glass(1.5f, 0))) < 1e-6f);
  CHECK(difference(alone, picture(outer, nullptr, &below)) < 1e-3f);
  CHECK(difference(alone, picture(outer, nullptr, &above)) > 2e-3f);
}

TEST_CASE("material: maps that shape the normal change the picture, flat ones do not") {
  PutMaterial plain = everything();
  const auto before = picture(plain);
  const auto flat = texel({0.5f, 0.5f, 1});
  const auto tilted = texel({0.8f, 0.5f, 0.9f});
  const auto with = [&](auto member, const PutTexture& texture) {
    PutMaterial m = everything();
    m.*member = TextureUsePatch{.texture = "texture", .use = {}};
    return picture(m, &texture);
  };
  CHECK(difference(before, with(&PutMaterial::normal_map, flat)) < 1e-5f);
  CHECK(difference(before, with(&PutMaterial::normal_map, tilted)) > 1e-3f);
  CHECK(difference(before, with(&PutMaterial::clearcoat_normal_map, flat)) < 1e-5f);
  CHECK(difference(before, with(&PutMaterial::clearcoat_normal_map, tilted)) > 1e-5f);
  CHECK(difference(before, with(&PutMaterial::bump_map, flat)) < 1e-6f);
  std::vector<float> ramp(64);
  for (std::size_t i = 0; i < ramp.size(); ++i) ramp[i] = float(i % 8 < 4);
  const auto texels = ArrayOf<float>(std::move(ramp));
  const PutTexture stripes{
      .image = std::make_shared<const ImageData>(ImageData{.texels = texels.buffer(),
                                                           .width = 8,
                                                           .height = 8,
                                                           .channels = 1,
                                                           .type = TexelType::kF32}),
      .srgb = false};
  CHECK(difference(before, with(&PutMaterial::bump_map, stripes)) > 1e-3f);
}
