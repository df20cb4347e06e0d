// Materials, by the list of their parameters: a field is named like its parameter.
#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr std::array kAlphaModes{AlphaMode::kOpaque, AlphaMode::kOpaque, AlphaMode::kMask,
                                 AlphaMode::kBlend};
static_assert(kAlphaModes.size() == v1::Material::AlphaMode_ARRAYSIZE);

constexpr float kDefaultCutoff = 0.5f;

#define HELIO_COUNT(name) +1
constexpr std::size_t kNormalMaps = HELIO_NORMAL_MAPS(HELIO_COUNT);
#undef HELIO_COUNT

/// A height is one channel of a texture.
constexpr bool is_height(std::string_view map) { return map == "bump_map"; }

Expected<vec3> to_value(float value, Range range) {
  auto checked = in_range(value, range);
  if (!checked) return std::unexpected(std::move(checked).error());
  return vec3(value, 0, 0);
}
Expected<vec3> to_value(const v1::Vec3& value, Range range) { return to_vec3(value, range); }

void set_value(const vec3& value, v1::ScalarParameter& message) { message.set_value(value.x); }
void set_value(const vec3& value, v1::ColorParameter& message) {
  *message.mutable_value() = to_proto(value);
}

template <class Message>
constexpr bool kIsScalar = std::is_same_v<Message, v1::ScalarParameter>;

/// Overwrites values that `clear` may have set.
template <class Message>
Status read_parameter(const Message& message, ArraySource& source, Range range,
                      ParameterPatch& patch) {
  if (message.has_value()) HELIO_TAKE(patch.value, to_value(message.value(), range), "value");
  if (message.has_texture())
    HELIO_TAKE(patch.texture, to_texture_use(message.texture(), source, kIsScalar<Message>),
               "texture");
  return {};
}

template <class Message>
void write_parameter(const ParameterPatch& patch, const ArraySink& sink, Message* message) {
  if (patch.value) set_value(*patch.value, *message);
  if (!patch.texture) return;
  *message->mutable_texture() = to_proto(*patch.texture, sink);
  if (!kIsScalar<Message>) message->mutable_texture()->clear_channel();
}

vec3 default_value(int components, float value) {
  return components == 3 ? vec3(value) : vec3(value, 0, 0);
}

template <MaterialParameter P>
void reset(PutMaterial& patch, vec3 value) {
  ParameterPatch& parameter = patch.parameters[std::size_t(P)];
  parameter.value = value;
  parameter.texture.emplace();
}

constexpr std::array<Clear<PutMaterial>, kMaterialParameters + 6 + kNormalMaps> kClear{{
#define HELIO_CLEAR(name, components, value, low, high)                          \
  {#name, [](PutMaterial& p) {                                                   \
     reset<MaterialParameter::name>(p, default_value(components, float(value))); \
   }},
    HELIO_MATERIAL_PARAMETERS(HELIO_CLEAR)
#undef HELIO_CLEAR
        {"alpha_mode", [](PutMaterial& p) { p.alpha_mode = AlphaMode::kOpaque; }},
    {"alpha_cutoff", [](PutMaterial& p) { p.alpha_cutoff = kDefaultCutoff; }},
#define HELIO_CLEAR_MAP(name) {#name, [](PutMaterial& p) { p.name = TextureUsePatch{}; }},
    HELIO_NORMAL_MAPS(HELIO_CLEAR_MAP)
#undef HELIO_CLEAR_MAP
        {"two_sided_emission", [](PutMaterial& p) { p.two_sided_emission = false; }},
    {"unlit", [](PutMaterial& p) { p.unlit = false; }},
    {"thin_walled", [](PutMaterial& p) { p.thin_walled = false; }},
    {"priority", [](PutMaterial& p) { p.priority = 0; }},
}};

}  // namespace

Expected<PutMaterial> to_material(const v1::Material& message, ArraySource& source) {
  PutMaterial patch;
  HELIO_TRY(clear_fields(message.clear(), kClear, patch));
#define HELIO_READ(name, components, value, low, high)                                  \
  if (message.has_##name())                                                             \
    HELIO_CHECK(read_parameter(message.name(), source, {low, high},                     \
                               patch.parameters[std::size_t(MaterialParameter::name)]), \
                #name);
  HELIO_MATERIAL_PARAMETERS(HELIO_READ)
#undef HELIO_READ
#define HELIO_READ_MAP(name) \
  if (message.has_##name())  \
    HELIO_TAKE(patch.name, to_texture_use(message.name(), source, is_height(#name)), #name);
  HELIO_NORMAL_MAPS(HELIO_READ_MAP)
#undef HELIO_READ_MAP
  if (message.has_alpha_mode()) patch.alpha_mode = from_enum(kAlphaModes, message.alpha_mode());
  if (message.has_alpha_cutoff())
    HELIO_TAKE(patch.alpha_cutoff, in_range(message.alpha_cutoff(), {0, 1}), "alpha_cutoff");
  if (message.has_two_sided_emission()) patch.two_sided_emission = message.two_sided_emission();
  if (message.has_unlit()) patch.unlit = message.unlit();
  if (message.has_thin_walled()) patch.thin_walled = message.thin_walled();
  if (message.has_priority()) patch.priority = message.priority();
  return patch;
}

v1::Material to_proto(const PutMaterial& patch, const ArraySink& sink) {
  v1::Material message;
#define HELIO_WRITE(name, ...)                                                \
  if (const auto& p = patch.parameters[std::size_t(MaterialParameter::name)]; \
      p.value || p.texture)                                                   \
    write_parameter(p, sink, message.mutable_##name());
  HELIO_MATERIAL_PARAMETERS(HELIO_WRITE)
#undef HELIO_WRITE
#define HELIO_WRITE_MAP(name)                                         \
  if (patch.name) {                                                   \
    *message.mutable_##name() = to_proto(*patch.name, sink);          \
    if (!is_height(#name)) message.mutable_##name()->clear_channel(); \
  }
  HELIO_NORMAL_MAPS(HELIO_WRITE_MAP)
#undef HELIO_WRITE_MAP
  if (patch.alpha_mode)
    message.set_alpha_mode(to_enum<v1::Material::AlphaMode>(kAlphaModes, *patch.alpha_mode));
  if (patch.alpha_cutoff) message.set_alpha_cutoff(*patch.alpha_cutoff);
  if (patch.two_sided_emission) message.set_two_sided_emission(*patch.two_sided_emission);
  if (patch.unlit) message.set_unlit(*patch.unlit);
  if (patch.thin_walled) message.set_thin_walled(*patch.thin_walled);
  if (patch.priority) message.set_priority(*patch.priority);
  return message;
}

}  // namespace heliograph::server
