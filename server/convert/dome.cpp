// The dome: light from infinitely far.
#include <fmt/format.h>

#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr Range kBrightness{0, 1e15};
constexpr float kOrthonormalTolerance = 1e-4f;

constexpr std::array<Clear<PutDome>, 6> kClear{{
    {"texture", [](PutDome& p) { p.texture = Ref{}; }},
    {"color", [](PutDome& p) { p.color.emplace(std::nullopt); }},
    {"intensity", [](PutDome& p) { p.intensity = 1; }},
    {"rotation", [](PutDome& p) { p.world_from_dome = mat3(1); }},
    {"camera_visible", [](PutDome& p) { p.camera_visible = true; }},
    {"light_group", [](PutDome& p) { p.light_group.emplace(); }},
}};

Expected<mat3> to_rotation(const v1::Array& array, ArraySource& source) {
  auto raw = read_f32(array, source, {kThree, kThree}, 9);
  if (!raw) return std::unexpected(std::move(raw).error());
  const auto n = raw->as<float>();
  const mat3 rotation(n[0], n[3], n[6], n[1], n[4], n[7], n[2], n[5], n[8]);
  const mat3 error = glm::transpose(rotation) * rotation - mat3(1);
  float worst = std::abs(glm::determinant(rotation) - 1);
  for (int c = 0; c < 3; ++c)
    for (int r = 0; r < 3; ++r) worst = std::max(worst, std::abs(error[c][r]));
  if (!(worst <= kOrthonormalTolerance))
    return fail(
        Code::kInvalidArgument, "",
        fmt::format("is off a rotation by {}; give an orthonormal matrix with determinant 1",
                    worst));
  return rotation;
}

}  // namespace

Expected<PutDome> to_dome(const v1::Dome& message, ArraySource& source) {
  PutDome patch;
  HELIO_TRY(clear_fields(message.clear(), kClear, patch));
  if (message.has_texture()) HELIO_TAKE(patch.texture, to_ref(message.texture()), "texture");
  if (message.has_color()) HELIO_TAKE(patch.color, to_vec3(message.color(), kBrightness), "color");
  if (message.has_intensity())
    HELIO_TAKE(patch.intensity, in_range(message.intensity(), kBrightness), "intensity");
  if (message.has_rotation())
    HELIO_TAKE(patch.world_from_dome, to_rotation(message.rotation(), source), "rotation");
  if (message.has_camera_visible()) patch.camera_visible = message.camera_visible();
  if (message.has_light_group())
    HELIO_TAKE(patch.light_group, to_group(message.light_group()), "light_group");
  return patch;
}

v1::Dome to_proto(const PutDome& patch, const ArraySink& sink) {
  v1::Dome message;
  if (patch.texture) *message.mutable_texture() = to_proto(*patch.texture);
  if (patch.color && *patch.color)
    *message.mutable_color() = to_proto(**patch.color);
  else if (patch.color)
    message.add_clear("color");
  if (patch.intensity) message.set_intensity(*patch.intensity);
  if (patch.world_from_dome) {
    std::vector<float> numbers;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) numbers.push_back((*patch.world_from_dome)[c][r]);
    const u64 shape[] = {3, 3};
    *message.mutable_rotation() = to_array(std::move(numbers), shape, sink);
  }
  if (patch.camera_visible) message.set_camera_visible(*patch.camera_visible);
  if (patch.light_group) message.set_light_group(*patch.light_group);
  return message;
}

}  // namespace heliograph::server
