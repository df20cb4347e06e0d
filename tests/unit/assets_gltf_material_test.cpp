// glTF materials and textures: parameters, channels, encodings, samplers and texture transforms.
#include <fmt/format.h>

#include <cmath>

#include "renderer/assets/load.h"
#include "renderer/assets/picture.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

const ParameterPatch& parameter(const PutMaterial& material, MaterialParameter p) {
  return material.parameters[std::size_t(p)];
}

/// A document with one material, an RGBA image (0), a gray one (1), and textures of both.
Expected<Loaded> load_material(const std::string& material, const std::string& more = "") {
  TestBundle bundle;
  bundle.add("m.gltf",
             R"({"asset":{"version":"2.0"},"images":[{"uri":"orm.png"},{"uri":"cube_depth.png"}],)"
             R"("samplers":[{"wrapS":33071,"wrapT":33648,"magFilter":9728}],)"
             R"("textures":[{"source":0},{"source":1},{"source":0,"sampler":0}],)"
             R"("materials":[{)" +
                 material + "}]" + more + "}");
  bundle.add("orm.png", read_file(test_assets() / "picture/orm.png"));
  bundle.add("cube_depth.png", read_file(test_assets() / "picture/cube_depth.png"));
  return bundle.load();
}

PutMaterial material_of(const std::string& json) {
  const auto loaded = load_material(json);
  INFO(refusal(loaded));
  REQUIRE(loaded);
  return library_item<PutMaterial>(*loaded);
}

}  // namespace

TEST_CASE("gltf: a material without a word has glTF's defaults, not ours") {
  const PutMaterial material = material_of("");
  CHECK(parameter(material, base_color).value == vec3(1));
  CHECK(parameter(material, metallic).value == vec3(1));
  CHECK(parameter(material, roughness).value == vec3(1));
  CHECK(parameter(material, emission).value == vec3(0));
  CHECK(material.alpha_mode == AlphaMode::kOpaque);
  CHECK(material.two_sided_emission == false);
}

TEST_CASE("gltf: metallic from blue, roughness from green, both linear; colour is sRGB") {
  const auto loaded = load_material(
      R"("pbrMetallicRoughness":{"baseColorTexture":{"index":0},"baseColorFactor":[0.5,0.6,0.7,0.8],)"
      R"("metallicRoughnessTexture":{"index":0},"metallicFactor":0.25})");
  REQUIRE(loaded);
  const PutMaterial& material = library_item<PutMaterial>(*loaded);
  CHECK(parameter(material, metallic).texture->use.channel == 2);
  CHECK(parameter(material, roughness).texture->use.channel == 1);
  CHECK(parameter(material, metallic).value->x == 0.25f);
  CHECK(parameter(material, base_color).value == vec3(0.5f, 0.6f, 0.7f));
  CHECK_FALSE(parameter(material, alpha).texture);  // OPAQUE ignores alpha
  // One picture, two encodings: two textures over the same texels.
  const PutTexture& color = library_item<PutTexture>(*loaded, 0);
  const PutTexture& data = library_item<PutTexture>(*loaded, 1);
  CHECK(*color.srgb);
  CHECK_FALSE(*data.srgb);
  CHECK(color.image->texels->serial() == data.image->texels->serial());
  CHECK_THROWS(library_item<PutTexture>(*loaded, 2));
}

TEST_CASE("gltf: alpha comes from the alpha channel, where there is one") {
  const PutMaterial mask =
      material_of(R"("alphaMode":"MASK","alphaCutoff":0.3,"pbrMetallicRoughness":)"
                  R"({"baseColorTexture":{"index":0},"baseColorFactor":[1,1,1,0.5]})");
  CHECK(mask.alpha_mode == AlphaMode::kMask);
  CHECK(*mask.alpha_cutoff == 0.3f);
  CHECK(parameter(mask, alpha).texture->use.channel == 3);
  CHECK(parameter(mask, alpha).value->x == 0.5f);
  const PutMaterial gray =
      material_of(R"("alphaMode":"BLEND","pbrMetallicRoughness":{"baseColorTexture":{"index":1},)"
                  R"("metallicRoughnessTexture":{"index":1}})");
  CHECK_FALSE(parameter(gray, alpha).texture);
  CHECK(parameter(gray, metallic).texture->use.channel == 0);
}

TEST_CASE("gltf: alpha beside grey is the fourth component of a texel, as renderers read it") {
  const auto loaded =
      TestBundle()
          .add(
              "m.gltf",
              R"({"asset":{"version":"2.0"},"images":[{"uri":)"
              R"("data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mM44QAAAdMBCaFer5cAAAAASUVORK5CYII="}],)"
              R"("textures":[{"source":0}],"materials":[{"alphaMode":"BLEND",)"
              R"("pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}]})")
          .load();
  REQUIRE(loaded);
  CHECK(library_item<PutTexture>(*loaded).image->channels == 2);
  CHECK(parameter(library_item<PutMaterial>(*loaded), alpha).texture->use.channel == 3);
}

TEST_CASE("gltf: samplers and texture transforms") {
  const auto loaded = load_material(
      R"("normalTexture":{"index":2,"scale":0.5,"texCoord":1,"extensions":{"KHR_texture_transform":)"
      R"({"offset":[0.1,0.2],"rotation":0.5,"scale":[2,3]}}})");
  REQUIRE(loaded);
  const PutTexture& texture = library_item<PutTexture>(*loaded);
  CHECK(*texture.nearest);
  CHECK(*texture.wrap_u == Wrap::kClamp);
  CHECK(*texture.wrap_v == Wrap::kMirror);
  const TextureUse& use = library_item<PutMaterial>(*loaded).normal_map->use;
  CHECK(use.uv_set == 1);
  CHECK(use.scale == 0.5f);
  // offset + rotation * scale, counter-clockwise in the picture, whose v runs down.
  const vec2 uv(0.3f, 0.4f);
  const double c = std::cos(0.5), s = std::sin(0.5);
  const double u_out = 0.1 + c * 2 * 0.3 + s * 3 * (1 - 0.4);
  const double v_out = 0.2 - s * 2 * 0.3 + c * 3 * (1 - 0.4);
  const vec2 ours = use.uv_transform * vec3(uv, 1);
  CHECK(ours.x == Approx(u_out));
  CHECK(ours.y == Approx(1 - v_out));
}

TEST_CASE("gltf: the material extensions that have a parameter") {
  const PutMaterial material = material_of(
      R"("doubleSided":true,"emissiveFactor":[1,0.5,0],"emissiveTexture":{"index":0},"extensions":{)"
      R"("KHR_materials_emissive_strength":{"emissiveStrength":20},)"
      R"("KHR_materials_ior":{"ior":1.33},"KHR_materials_unlit":{},)"
      R"("KHR_materials_transmission":{"transmissionFactor":0.9,"transmissionTexture":{"index":0}},)"
      R"("KHR_materials_specular":{"specularFactor":0.4,"specularTexture":{"index":0},)"
      R"("specularColorFactor":[0.1,0.2,0.3]}})");
  CHECK(*material.two_sided_emission);
  CHECK(*material.unlit);
  CHECK(parameter(material, emission).value == vec3(1, 0.5f, 0));
  CHECK(parameter(material, emission_strength).value->x == 20);
  CHECK(parameter(material, ior).value->x == 1.33f);
  CHECK(parameter(material, transmission).value->x == 0.9f);
  CHECK(parameter(material, transmission).texture->use.channel == 0);
  CHECK(parameter(material, specular).texture->use.channel == 3);
  CHECK(parameter(material, specular_color).value == vec3(0.1f, 0.2f, 0.3f));
}

TEST_CASE("gltf: clearcoat, sheen, anisotropy and thickness") {
  const PutMaterial material = material_of(
      R"("pbrMetallicRoughness":{"roughnessFactor":0.5},"extensions":{)"
      R"("KHR_materials_clearcoat":{"clearcoatFactor":0.7,"clearcoatTexture":{"index":0},)"
      R"("clearcoatRoughnessFactor":0.2,"clearcoatRoughnessTexture":{"index":0},)"
      R"("clearcoatNormalTexture":{"index":0,"scale":0.5}},)"
      R"("KHR_materials_sheen":{"sheenColorFactor":[0.1,0.2,0.3],"sheenRoughnessFactor":0.4,)"
      R"("sheenRoughnessTexture":{"index":0}},)"
      R"("KHR_materials_anisotropy":{"anisotropyStrength":0.5,"anisotropyRotation":-1.5707963},)"
      R"("KHR_materials_transmission":{"transmissionFactor":1}})");
  CHECK(parameter(material, clearcoat).value->x == 0.7f);
  CHECK(parameter(material, clearcoat).texture->use.channel == 0);
  CHECK(parameter(material, clearcoat_roughness).value->x == 0.2f);
  CHECK(parameter(material, clearcoat_roughness).texture->use.channel == 1);
  CHECK(material.clearcoat_normal_map->use.scale == 0.5f);
  CHECK(parameter(material, sheen).value->x == 1);
  CHECK(parameter(material, sheen_color).value == vec3(0.1f, 0.2f, 0.3f));
  CHECK(parameter(material, sheen_roughness).texture->use.channel == 3);
  CHECK(*material.thin_walled);
  // alpha along the tangent mix(0.25, 1, 0.25), across it 0.25
  const float a = std::sqrt(1 - 0.9f * parameter(material, anisotropic).value->x);
  const float r2 = std::pow(parameter(material, roughness).value->x, 2.0f);
  CHECK(r2 / a == Approx(0.4375));
  CHECK(r2 * a == Approx(0.25));
  CHECK(parameter(material, anisotropic_rotation).value->x == Approx(0.75));
  const PutMaterial solid =
      material_of(R"("extensions":{"KHR_materials_transmission":{"transmissionFactor":1},)"
                  R"("KHR_materials_volume":{"thicknessFactor":0.1}})");
  CHECK_FALSE(*solid.thin_walled);
  CHECK_FALSE(parameter(solid, attenuation_distance).value);
  const PutMaterial wine =
      material_of(R"("extensions":{"KHR_materials_transmission":{"transmissionFactor":1},)"
                  R"("KHR_materials_volume":{"thicknessFactor":0.1,"attenuationDistance":0.02,)"
                  R"("attenuationColor":[0.9,0.2,0.1]}})");
  CHECK(parameter(wine, attenuation_distance).value->x == 0.02f);
  CHECK(parameter(wine, attenuation_color).value == vec3(0.9f, 0.2f, 0.1f));
}

TEST_CASE("gltf: a thin film, its texture mixes the two thicknesses") {
  const PutMaterial plain =
      material_of(R"("extensions":{"KHR_materials_iridescence":{"iridescenceFactor":0.7,)"
                  R"("iridescenceIor":1.8,"iridescenceThicknessMaximum":550}})");
  CHECK(parameter(plain, iridescence).value->x == 0.7f);
  CHECK(parameter(plain, iridescence_ior).value->x == 1.8f);
  CHECK(parameter(plain, iridescence_thickness).value->x == 550);
  const PutMaterial standard = material_of(R"("extensions":{"KHR_materials_iridescence":{}})");
  CHECK(parameter(standard, iridescence).value->x == 0);
  CHECK(parameter(standard, iridescence_ior).value->x == 1.3f);
  CHECK(parameter(standard, iridescence_thickness).value->x == 400);
  for (const auto& [minimum, maximum] : {std::pair(200, 500), std::pair(500, 200)}) {
    const PutMaterial textured = material_of(fmt::format(
        R"("extensions":{{"KHR_materials_iridescence":{{"iridescenceFactor":1,)"
        R"("iridescenceTexture":{{"index":0}},"iridescenceThicknessTexture":{{"index":0}},)"
        R"("iridescenceThicknessMinimum":{},"iridescenceThicknessMaximum":{}}}}})",
        minimum, maximum));
    CHECK(parameter(textured, iridescence).texture->use.channel == 0);
    const ParameterPatch& thickness = parameter(textured, iridescence_thickness);
    const TextureUse& use = thickness.texture->use;
    CHECK(use.channel == 1);
    for (const float texel : {0.0f, 0.25f, 1.0f})
      CHECK(thickness.value->x * (texel * use.scale + use.offset) ==
            Approx(float(minimum) + texel * float(maximum - minimum)).margin(1e-3));
  }
}

TEST_CASE("gltf: diffuse transmission is a sheet's unless it has a volume; dispersion") {
  const std::string leaf =
      R"("KHR_materials_diffuse_transmission":{"diffuseTransmissionFactor":0.7,)"
      R"("diffuseTransmissionColorFactor":[0.1,0.2,0.3],"diffuseTransmissionTexture":{"index":0},)"
      R"("diffuseTransmissionColorTexture":{"index":0}})";
  const PutMaterial sheet = material_of(R"("extensions":{)" + leaf + "}");
  CHECK(parameter(sheet, diffuse_transmission).value->x == Approx(0.7));
  CHECK(*parameter(sheet, diffuse_transmission_color).value == vec3(0.1f, 0.2f, 0.3f));
  CHECK(parameter(sheet, diffuse_transmission_color).texture);
  CHECK(*sheet.thin_walled);
  const PutMaterial wax =
      material_of(R"("extensions":{"KHR_materials_volume":{"thicknessFactor":1,)"
                  R"("attenuationDistance":0.5},"KHR_materials_dispersion":{"dispersion":0.33},)" +
                  leaf + "}");
  CHECK_FALSE(*wax.thin_walled);
  CHECK(parameter(wax, attenuation_distance).value->x == 0.5f);
  CHECK(parameter(wax, dispersion).value->x == 0.33f);
}

TEST_CASE("gltf: specular-glossiness becomes a dielectric of that reflection") {
  const PutMaterial material = material_of(
      R"("extensions":{"KHR_materials_pbrSpecularGlossiness":{"diffuseFactor":[0.2,0.3,0.4,1],)"
      R"("specularFactor":[0.02,0.04,0.08],"glossinessFactor":0.75,)"
      R"("specularGlossinessTexture":{"index":0}}})");
  CHECK(parameter(material, base_color).value == vec3(0.2f, 0.3f, 0.4f));
  CHECK(parameter(material, metallic).value->x == 0);
  CHECK(parameter(material, specular_color).value->z == Approx(2));
  const auto& use = parameter(material, roughness).texture->use;
  // roughness = 1 - glossiness * texel
  CHECK(parameter(material, roughness).value->x * (0.5f * use.scale + use.offset) ==
        Approx(1 - 0.75 * 0.5));
}

TEST_CASE("gltf: what is left out or clamped says so") {
  const auto loaded = load_material(R"("pbrMetallicRoughness":{"roughnessFactor":3})",
                                    R"(,"extensionsUsed":["EXT_texture_avif","KHR_xmp_json_ld"])");
  REQUIRE(loaded);
  CHECK(parameter(library_item<PutMaterial>(*loaded), roughness).value->x == 1);
  REQUIRE(loaded->warnings.size() == 2);
  CHECK_THAT(loaded->warnings[0], Contains("EXT_texture_avif"));
  const auto required = [](const std::string& name) {
    return refusal(load_material("", R"(,"extensionsRequired":[")" + name + "\"]"));
  };
  for (const char* name :
       {"KHR_materials_volume_scatter", "EXT_texture_avif", "MSFT_texture_dds"}) {
    CHECK_THAT(required(name), Contains("12 ") && Contains(name));
  }
}

TEST_CASE("gltf: a sheen too smooth for the model says so, where there is one") {
  const auto warnings = [](const std::string& sheen) {
    return load_material(R"("extensions":{"KHR_materials_sheen":{)" + sheen + "}}")->warnings;
  };
  CHECK(warnings(R"("sheenColorFactor":[1,1,1],"sheenRoughnessFactor":0.25)").empty());
  CHECK(warnings("").empty());
  CHECK_THAT(warnings(R"("sheenColorFactor":[1,0,0],"sheenRoughnessFactor":0.1)").at(0),
             Contains("materials[0]: a sheen roughness of 0.1 acts as 0.25"));
}

TEST_CASE("gltf: one filter of a texture's two") {
  const auto load = [](const std::string& sampler) {
    TestBundle bundle;
    bundle.add("m.gltf",
               R"({"asset":{"version":"2.0"},"images":[{"uri":"orm.png"}],"samplers":[{)" +
                   sampler +
                   R"(}],"textures":[{"source":0,"sampler":0}],)"
                   R"("materials":[{"normalTexture":{"index":0}}]})");
    bundle.add("orm.png", read_file(test_assets() / "picture/orm.png"));
    return bundle.load();
  };
  const auto nearest = [&](const std::string& sampler, std::size_t warnings = 0) {
    CAPTURE(sampler);
    const auto loaded = load(sampler);
    REQUIRE(loaded);
    CHECK(loaded->warnings.size() == warnings);
    return *library_item<PutTexture>(*loaded).nearest;
  };
  CHECK_FALSE(nearest(""));
  CHECK_FALSE(nearest(R"("magFilter":9729,"minFilter":9987)"));
  CHECK_FALSE(nearest(R"("magFilter":9729,"minFilter":9729)"));
  CHECK_FALSE(nearest(R"("minFilter":9985)"));
  CHECK(nearest(R"("minFilter":9728)"));
  CHECK(nearest(R"("minFilter":9986)"));
  CHECK(nearest(R"("magFilter":9728,"minFilter":9987)"));
  CHECK_FALSE(nearest(R"("magFilter":9729,"minFilter":9728)", 1));
  CHECK_THAT(refusal(load(R"("minFilter":9988)")), Contains("samplers[0].minFilter"));
  CHECK_THAT(refusal(load(R"("magFilter":9987)")), Contains("samplers[0].magFilter"));
}

TEST_CASE("gltf: the WebP picture of EXT_texture_webp goes before the texture's own") {
  TestBundle bundle;
  bundle.add("m.gltf",
             R"({"asset":{"version":"2.0"},"extensionsRequired":["EXT_texture_webp"],)"
             R"("images":[{"uri":"a.png"},{"uri":"b.webp"}],)"
             R"("textures":[{"source":0,"extensions":{"EXT_texture_webp":{"source":1}}}],)"
             R"("materials":[{"normalTexture":{"index":0}}]})");
  CHECK(bundle.load()->missing == std::vector<std::string>{"b.webp"});
  bundle.add("b.webp", read_file(test_assets() / "picture/gradient.webp"));
  const auto loaded = bundle.load();
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  CHECK(std::get<PutTexture>(loaded->asset.library.front().action).image->width == 16);
}

TEST_CASE("gltf: variants are named, the default is shown") {
  const auto loaded = load_material(
      "", R"(,"extensionsRequired":["KHR_materials_variants"],"extensions":{)"
          R"("KHR_materials_variants":{"variants":[{"name":"red"},{"name":"blue"}]}})");
  REQUIRE(loaded);
  CHECK_THAT(loaded->warnings.at(0),
             Contains("KHR_materials_variants") && Contains("red, blue") && Contains("variant="));
}

TEST_CASE("gltf: the variant that was asked for is shown") {
  GltfFile file;
  file.floats("VEC3", {0, 0, 0, 1, 0, 0, 0, 1, 0});
  const TestBundle bundle = file.bundle(
      R"("extensions":{"KHR_materials_variants":{"variants":[{"name":"red"},{"name":"blue"}]}},)"
      R"("materials":[{},{"pbrMetallicRoughness":{"baseColorFactor":[1,0,0,1]}}],)"
      R"("nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},)"
      R"("material":0,"extensions":{"KHR_materials_variants":{"mappings":[)"
      R"({"material":1,"variants":[1]}]}}}]}])");
  const auto shown = [&](const std::string& variant) {
    const auto loaded = bundle.load({.variant = variant});
    INFO(refusal(loaded));
    REQUIRE(loaded);
    CHECK(loaded->warnings.size() == (variant.empty() ? 1 : 0));
    for (const Edit& edit : loaded->asset.entities) {
      const auto* put = std::get_if<PutEntity>(&edit.action);
      if (!put || !put->materials) continue;
      const Ref& ref = put->materials->at(0);
      const Edit& made = loaded->asset.library.at(std::get<CreatedByEdit>(ref).edit);
      return parameter(std::get<PutMaterial>(made.action), base_color).value;
    }
    return std::optional<vec3>();
  };
  CHECK(shown("") == vec3(1));
  CHECK(shown("red") == vec3(1));  // it maps nothing
  CHECK(shown("blue") == vec3(1, 0, 0));
  CHECK_THAT(refusal(bundle.load({.variant = "green"})),
             Contains("variant: the file has no green; it has red, blue"));
  CHECK_THAT(refusal(TestBundle().add("a.stl", "solid").load({.variant = "red"})),
             Contains("variant: is of glTF"));
}

TEST_CASE("gltf: broken materials and pictures are refused by name") {
  const auto refused = [](const std::string& json, const std::string& more = "") {
    return refusal(load_material(json, more));
  };
  CHECK_THAT(refused(R"("normalTexture":{"index":7})"),
             Contains("materials[0].normalTexture.index: is 7"));
  CHECK_THAT(refused(R"("normalTexture":{})"), Contains("index: is missing"));
  CHECK_THAT(refused(R"("alphaMode":"GLASS")"), Contains("alphaMode"));
  CHECK_THAT(refused(R"("emissiveFactor":[1,1])"), Contains("3 numbers"));
  TestBundle bundle;
  bundle.add("m.gltf",
             R"({"asset":{"version":"2.0"},"images":[{"uri":"a.png"}],)"
             R"("textures":[{"source":0},{"extensions":{"KHR_texture_basisu":{"source":0}}}],)"
             R"("materials":[{"normalTexture":{"index":0}}]})");
  CHECK(bundle.load()->missing == std::vector<std::string>{"a.png"});
  TestBundle broken = bundle;
  broken.add("a.png", "\x89PNG\r\n\x1a\n and then nonsense");
  CHECK_THAT(refusal(broken.load()), Contains("images[0]: broken PNG"));
  TestBundle lying = bundle;
  lying.add("a.png", read_file(test_assets() / "picture/gradient.jpg"));
  const auto loaded = lying.load();
  REQUIRE(loaded);
  CHECK_THAT(loaded->warnings.at(0), Contains("image 0") && Contains("JPEG"));
}
