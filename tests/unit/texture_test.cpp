// Texture lookup: filtering, wrapping, decoding, channels, coordinates.
#include "kernels/material/texture.h"

#include <cstring>
#include <vector>

#include "kernels/schedule/scalar.h"
#include "tests/unit/catch.h"
#include "tests/unit/test_tracer.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

TextureView view_of(const void* texels, uvec2 size, u8 channels, TexelType type) {
  return {.texels = texels,
          .width = size.x,
          .height = size.y,
          .channels = channels,
          .type = type,
          .wrap_u = Wrap::kRepeat,
          .wrap_v = Wrap::kRepeat};
}

}  // namespace

TEST_CASE("texture: row 0 is the top, texels are centred") {
  const float texels[] = {1, 2, 3, 4};  // top row 1 2, bottom row 3 4
  const TextureView t = view_of(texels, {2, 2}, 1, TexelType::kF32);
  CHECK(sample_texture(t, {0.25f, 0.75f}).x == 1);
  CHECK(sample_texture(t, {0.75f, 0.75f}).x == 2);
  CHECK(sample_texture(t, {0.25f, 0.25f}).x == 3);
  CHECK(sample_texture(t, {0.75f, 0.25f}).x == 4);
  CHECK(sample_texture(t, {0.5f, 0.5f}).x == 2.5f);
  CHECK(sample_texture(t, {0.375f, 0.75f}).x == Approx(1.25f));
}

TEST_CASE("texture: wrap modes") {
  const float texels[] = {1, 2, 3, 4};
  TextureView t = view_of(texels, {4, 1}, 1, TexelType::kF32);
  CHECK(sample_texture(t, {0, 0.5f}).x == 2.5f);  // between 4 and 1
  CHECK(sample_texture(t, {1.125f, 0.5f}).x == 1);
  CHECK(sample_texture(t, {-0.125f, 0.5f}).x == 4);
  t.wrap_u = Wrap::kClamp;
  CHECK(sample_texture(t, {0, 0.5f}).x == 1);
  CHECK(sample_texture(t, {7, 0.5f}).x == 4);
  CHECK(sample_texture(t, {-7, 0.5f}).x == 1);
  t.wrap_u = Wrap::kMirror;
  CHECK(sample_texture(t, {-0.125f, 0.5f}).x == 1);
  CHECK(sample_texture(t, {1.125f, 0.5f}).x == 4);
  CHECK(sample_texture(t, {1.875f, 0.5f}).x == 1);
  CHECK(sample_texture(t, {2.125f, 0.5f}).x == 1);
}

TEST_CASE("texture: nearest") {
  const float texels[] = {1, 2, 3, 4};
  TextureView t = view_of(texels, {4, 1}, 1, TexelType::kF32);
  t.nearest = true;
  CHECK(sample_texture(t, {0.01f, 0.5f}).x == 1);
  CHECK(sample_texture(t, {0.24f, 0.5f}).x == 1);
  CHECK(sample_texture(t, {0.26f, 0.5f}).x == 2);
  CHECK(sample_texture(t, {0.9999999f, 0}).x == 4);
}

TEST_CASE("texture: 1 to 4 channels") {
  const u8 bytes[] = {51, 102, 153, 204};
  vec4 t = sample_texture(view_of(bytes, {1, 1}, 1, TexelType::kU8), {0, 0});
  CHECK((t.x == Approx(0.2f) && t.y == t.x && t.z == t.x && t.w == 1));
  t = sample_texture(view_of(bytes, {1, 1}, 2, TexelType::kU8), {0, 0});
  CHECK((t.x == Approx(0.2f) && t.z == t.x && t.w == Approx(0.4f)));
  t = sample_texture(view_of(bytes, {1, 1}, 3, TexelType::kU8), {0, 0});
  CHECK((t.y == Approx(0.4f) && t.z == Approx(0.6f) && t.w == 1));
  t = sample_texture(view_of(bytes, {1, 1}, 4, TexelType::kU8), {0, 0});
  CHECK((t.z == Approx(0.6f) && t.w == Approx(0.8f)));
}

TEST_CASE("texture: sRGB is decoded before filtering, alpha is not") {
  const u8 bytes[] = {0, 0, 0, 0, 255, 255, 255, 255};
  TextureView t = view_of(bytes, {2, 1}, 4, TexelType::kU8);
  t.srgb = true;
  CHECK(sample_texture(t, {0.5f, 0.5f}).x == 0.5f);
  const u8 grey[] = {188, 188, 188, 188};
  t = view_of(grey, {1, 1}, 4, TexelType::kU8);
  t.srgb = true;
  CHECK(sample_texture(t, {0, 0}).x == Approx(0.50289f).margin(1e-5));
  CHECK(sample_texture(t, {0, 0}).w == Approx(188 / 255.0f));
  const u16 deep[] = {u16(188 * 257)};
  t = view_of(deep, {1, 1}, 1, TexelType::kU16);
  t.srgb = true;
  CHECK(sample_texture(t, {0, 0}).x == Approx(0.50289f).margin(1e-5));
}

TEST_CASE("texture: halves") {
  CHECK(half_to_float(0x3c00) == 1);
  CHECK(half_to_float(0xc000) == -2);
  CHECK(half_to_float(0x7bff) == 65504);
  CHECK(half_to_float(0x0001) == 0x1p-24f);
  CHECK(half_to_float(0x03ff) == 1023 * 0x1p-24f);
  CHECK(half_to_float(0) == 0);
  CHECK(std::isinf(half_to_float(0x7c00)));
  CHECK(std::isnan(half_to_float(0x7e00)));
  CHECK(half_to_float(0xfc00) == -INFINITY);
}

TEST_CASE("texture: darkness where a texel is no light") {
  const float texels[] = {NAN, -3, 2, 0, 4, 1};
  const TextureView t = view_of(texels, {2, 1}, 3, TexelType::kF32);
  const vec4 middle = sample_texture<true>(t, {0.5f, 0.5f});
  CHECK((middle.x == 0 && middle.y == 2 && middle.z == 1.5f));
}

TEST_CASE(
    "material: a texture times its constant, with channel, scale, offset, uv set, transform") {
  const float texels[] = {0.1f, 0.2f, 0.3f, 0.4f, 0.5f, 0.6f, 0.7f, 0.8f};
  const TextureView textures[] = {view_of(texels, {2, 1}, 4, TexelType::kF32)};
  const TextureUseView uses[] = {
      {0, 0, 0, 1, 0, {1, 0}, {0, 1}, {0, 0}},        // base_color
      {0, 1, 2, 2, 0.1f, {0, 1}, {1, 0}, {0.5f, 0}},  // roughness: u and v swapped
      {0, 0, 3, 100, 0, {1, 0}, {0, 1}, {0, 0}}};     // alpha
  SceneView scene{};
  scene.textures = textures;
  scene.texture_uses = uses;
  MaterialView m{};
  m.constant.base_color = vec3(0.5f);
  m.constant.roughness = 0.5f;
  m.constant.metallic = 0.25f;
  m.constant.alpha = 1;
  m.textured = 1u << u32(ParameterBit::base_color) | 1u << u32(ParameterBit::roughness) | kAlphaBit;
  const Uvs uvs{{{0.25f, 0.5f}, {0, 0.25f}}};
  MaterialValues v = evaluate_material(scene, m, uvs, ~0u);
  CHECK(v.base_color.y == Approx(0.1f));
  CHECK(v.metallic == 0.25f);
  CHECK(v.roughness == Approx(0.5f * (0.7f * 2 + 0.1f)));  // u' = v + 0.5 = 0.75: second texel
  CHECK(v.alpha == 1);                                     // 40, clamped
  v = evaluate_material(scene, m, uvs, kAlphaBit);
  CHECK(v.roughness == 0.5f);
  CHECK(v.alpha == 1);
}

TEST_CASE("texture: seen from afar it keeps its mean and loses its noise") {
  PixelStatistics seen[2];
  for (const bool filtered : {false, true}) {
    TestScene scene;
    std::vector<float> checker(size_t(256) * 256);
    for (u32 i = 0; i < checker.size(); ++i) checker[i] = (i / 256 + i) % 2 ? 1 : 0;
    const u32 texture = scene.add_texture(std::move(checker), {256, 256}, TexelType::kF32);
    const std::vector<float> grey(size_t(128) * 128 * 2, 0.5f);
    if (filtered) scene.textures[texture].mips = grey.data();
    MaterialView m = lambert(vec3(1));
    m.unlit = true;
    m.textured = 1u << u32(ParameterBit::base_color);
    scene.texture_uses = {{texture, 0, 0, 1, 0, {1, 0}, {0, 1}, {0, 0}}};
    scene.add_instance(scene.add(rectangle(1, 1)), scene.add(m));
    const SceneView& view = scene.finish();
    const CameraView camera = look_at({0, 0, 5}, {0, 0, 0}, {1, 1}, 0.05f);
    const TestTracer tracer(view);
    const TestFilm film({1, 1}, kBeauty);
    render_pixel(view, camera, standard_settings(1), tracer, film.view, 0, 0, 0, 256);
    seen[filtered] = pixel_statistics(film.view, 0, 256);
  }
  CHECK(seen[1].mean == 0.5f);
  CHECK(seen[0].mean == Approx(0.5f).margin(0.1));
  CHECK(seen[0].variance > 1e-4f);
  CHECK(seen[1].variance == 0);
}
