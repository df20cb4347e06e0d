// KHR_materials_anisotropy against its own arithmetic.
#include <fmt/format.h>

#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

const ParameterPatch& parameter(const PutMaterial& material, MaterialParameter p) {
  return material.parameters[std::size_t(p)];
}

/// A material over a picture of 2 x 1 texels: at the left along u + v with full strength, at the
/// right along -u with a strength of 1/5.
Expected<Loaded> load_brushed(const std::string& roughness, const std::string& brushed) {
  const std::string png =
      "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAIAAAB7QOjdAAAAD0lEQVR42mP4//8/"
      "Q4MxABArA7FYuHeOAAAAAElFTkSuQmCC";
  TestBundle bundle;
  bundle.add("m.gltf",
             R"({"asset":{"version":"2.0"},"images":[{"uri":"data:image/png;base64,)" + png +
                 R"("}],"samplers":[{"wrapS":33071}],"textures":[{"source":0,"sampler":0}],)"
                 R"("materials":[{"pbrMetallicRoughness":{)" +
                 roughness + R"(},"extensions":{"KHR_materials_anisotropy":{)" + brushed + "}}}]}");
  return bundle.load();
}

double texel_of(const Loaded& loaded, const PutMaterial& material, MaterialParameter p, u32 x) {
  const ParameterPatch& own = parameter(material, p);
  const auto& put = std::get<PutTexture>(
      loaded.asset.library[std::get<CreatedByEdit>(own.texture->texture).edit].action);
  CHECK_FALSE(*put.srgb);
  CHECK(*put.nearest == (p == anisotropic_rotation));
  CHECK(*put.wrap_u == Wrap::kClamp);
  REQUIRE(put.image->type == TexelType::kU16);
  // RGBA as renderers read it: the second of two channels is alpha.
  const u32 channels = put.image->channels;
  const u32 channel = own.texture->use.channel == 3 ? channels - 1 : 0;
  u16 value;
  std::memcpy(&value, put.image->texels->bytes().data() + 2 * (x * channels + channel), 2);
  return own.value->x * value / 65535.0;
}

}  // namespace

TEST_CASE("gltf: a texture's directions and strengths of anisotropy") {
  const double pi = 3.14159265358979;
  const auto loaded = load_brushed(R"("roughnessFactor":0.7)",
                                   fmt::format(R"("anisotropyStrength":1,"anisotropyRotation":{},)"
                                               R"("anisotropyTexture":{{"index":0}})",
                                               pi / 2));
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  const PutMaterial& material = library_item<PutMaterial>(*loaded);
  const auto at = [&](MaterialParameter p, u32 x) { return texel_of(*loaded, material, p, x); };
  CHECK(at(anisotropic_rotation, 0) == Approx(0.25 + 0.125).margin(1e-3));
  CHECK(at(anisotropic_rotation, 1) == Approx(0.25 + 0.5).margin(1e-3));
  for (const u32 x : {0u, 1u}) {
    const double strength = x == 0 ? 1 : 0.2;
    const double a = std::sqrt(1 - 0.9 * at(anisotropic, x));
    const double alpha = std::pow(at(roughness, x), 2);
    CHECK(alpha * a == Approx(0.49).epsilon(1e-3));
    CHECK(alpha / a == Approx(0.49 + 0.51 * strength * strength).epsilon(1e-3));
  }
  // A texture of the roughness that lies as the anisotropy's does.
  const std::string both = R"("anisotropyStrength":1,"anisotropyTexture":{"index":0})";
  const auto textured = load_brushed(R"("metallicRoughnessTexture":{"index":0})", both);
  REQUIRE(textured);
  const PutMaterial& rough = library_item<PutMaterial>(*textured);
  const double a = std::sqrt(1 - 0.9 * texel_of(*textured, rough, anisotropic, 1));
  const double green = 128 / 255.0;
  CHECK(std::pow(texel_of(*textured, rough, roughness, 1), 2) * a ==
        Approx(green * green).epsilon(1e-3));
  const auto apart = load_brushed(
      R"("metallicRoughnessTexture":{"index":0,"extensions":{"KHR_texture_transform":{"scale":[2,2]}}})",
      both);
  REQUIRE(apart);
  CHECK_THAT(apart->warnings.at(0), Contains("anisotropy texture is left out"));
  CHECK_FALSE(parameter(library_item<PutMaterial>(*apart), anisotropic).texture);
}

TEST_CASE("gltf: anisotropy beyond the model's says so") {
  const auto loaded = load_brushed(R"("roughnessFactor":0.2)", R"("anisotropyStrength":1)");
  REQUIRE(loaded);
  CHECK(parameter(library_item<PutMaterial>(*loaded), anisotropic).value->x == 1);
  CHECK_THAT(loaded->warnings.at(0), Contains("by 10 at most, the file says 25"));
}
