// Entities: which components they have and what they bind.
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr std::array<Clear<PutEntity>, 17> kClear{{
    {"parent", [](PutEntity& p) { p.parent = Ref{}; }},
    {"pose", [](PutEntity& p) { p.pose = PosePatch{{}, {mat4x3(1)}}; }},
    {"mesh", [](PutEntity& p) { p.mesh = Ref{}; }},
    {"materials", [](PutEntity& p) { p.materials.emplace(); }},
    {"light", [](PutEntity& p) { p.light.emplace(std::nullopt); }},
    {"portal", [](PutEntity& p) { p.portal.emplace(std::nullopt); }},
    {"camera", [](PutEntity& p) { p.camera.emplace(std::nullopt); }},
    {"volume", [](PutEntity& p) { p.volume = Ref{}; }},
    {"skin", [](PutEntity& p) { p.skin.emplace(std::nullopt); }},
    {"morph_weights", [](PutEntity& p) { p.morph_weights.emplace(std::nullopt); }},
    {"label", [](PutEntity& p) { p.label.emplace(); }},
    {"visible", [](PutEntity& p) { p.visible = true; }},
    {"visibility", [](PutEntity& p) { p.visibility = kAllRays; }},
    {"static", [](PutEntity& p) { p.is_static = false; }},
    {"attributes", [](PutEntity& p) { p.attributes.emplace(); }},
    {"light_group", [](PutEntity& p) { p.light_group.emplace(); }},
    {"shadow_catcher", [](PutEntity& p) { p.shadow_catcher = false; }},
}};

u8 to_visibility(const v1::Visibility& m) {
  const auto bit = [](bool has, bool value, RayMask mask) { return u8(!has || value ? mask : 0); };
  return bit(m.has_camera(), m.camera(), kCameraRay) |
         bit(m.has_diffuse(), m.diffuse(), kDiffuseRay) |
         bit(m.has_glossy(), m.glossy(), kGlossyRay) |
         bit(m.has_transmission(), m.transmission(), kTransmissionRay) |
         bit(m.has_shadow(), m.shadow(), kShadowRay) | bit(m.has_volume(), m.volume(), kVolumeRay);
}

v1::Visibility visibility_to_proto(u8 mask) {
  v1::Visibility message;
  message.set_camera(mask & kCameraRay);
  message.set_diffuse(mask & kDiffuseRay);
  message.set_glossy(mask & kGlossyRay);
  message.set_transmission(mask & kTransmissionRay);
  message.set_shadow(mask & kShadowRay);
  message.set_volume(mask & kVolumeRay);
  return message;
}

/// References of an entity.
Status read_bindings(const v1::Entity& message, ArraySource& source, PutEntity& patch) {
  if (message.has_parent()) HELIO_TAKE(patch.parent, to_ref(message.parent()), "parent");
  if (message.has_mesh()) HELIO_TAKE(patch.mesh, to_ref(message.mesh()), "mesh");
  if (message.has_materials())
    HELIO_TAKE(patch.materials, to_refs(message.materials().parts()), "materials.parts");
  if (message.has_volume()) HELIO_TAKE(patch.volume, to_ref(message.volume()), "volume");
  if (message.has_skin()) HELIO_TAKE(patch.skin, to_skin(message.skin(), source), "skin");
  return {};
}

/// Writes a component, or adds its name to `clear` when it is removed.
template <class T, class Write>
void write_component(const Boxed<std::optional<T>>& component, const char* name,
                     v1::Entity& message, Write&& write) {
  if (component && *component)
    write(**component);
  else if (component)
    message.add_clear(name);
}

}  // namespace

Expected<PutEntity> to_entity(const v1::Entity& message, ArraySource& source) {
  PutEntity patch;
  HELIO_TRY(clear_fields(message.clear(), kClear, patch));
  HELIO_TRY(read_bindings(message, source, patch));
  if (message.has_pose()) HELIO_TAKE(patch.pose, to_pose(message.pose(), source), "pose");
  if (message.has_light()) HELIO_TAKE(patch.light, to_light(message.light(), source), "light");
  if (message.has_portal()) HELIO_TAKE(patch.portal, to_portal(message.portal()), "portal");
  if (message.has_camera()) HELIO_TAKE(patch.camera, to_camera(message.camera(), source), "camera");
  if (message.has_morph_weights())
    HELIO_TAKE(patch.morph_weights, to_morph_weights(message.morph_weights(), source),
               "morph_weights");
  if (message.has_label()) HELIO_TAKE(patch.label, to_label(message.label()), "label");
  if (message.has_visible()) patch.visible = message.visible();
  if (message.has_visibility()) patch.visibility = to_visibility(message.visibility());
  if (message.has_static_()) patch.is_static = message.static_();
  if (message.has_shadow_catcher()) patch.shadow_catcher = message.shadow_catcher();
  patch.teleport = message.teleport();
  if (message.has_attributes())
    patch.attributes.emplace(message.attributes().values().begin(),
                             message.attributes().values().end());
  if (message.has_light_group())
    HELIO_TAKE(patch.light_group, to_group(message.light_group()), "light_group");
  return patch;
}

v1::Entity to_proto(const PutEntity& patch, const ArraySink& sink) {
  v1::Entity message;
  if (patch.parent) *message.mutable_parent() = to_proto(*patch.parent);
  if (patch.pose) *message.mutable_pose() = to_proto(*patch.pose, sink);
  if (patch.mesh) *message.mutable_mesh() = to_proto(*patch.mesh);
  if (patch.materials) {
    message.mutable_materials();
    for (const Ref& material : *patch.materials)
      *message.mutable_materials()->add_parts() = to_proto(material);
  }
  write_component(patch.light, "light", message,
                  [&](const LightPatch& p) { *message.mutable_light() = to_proto(p, sink); });
  write_component(patch.portal, "portal", message,
                  [&](const Portal& p) { *message.mutable_portal() = to_proto(p); });
  write_component(patch.camera, "camera", message,
                  [&](const Camera& c) { *message.mutable_camera() = to_proto(c, sink); });
  if (patch.volume) *message.mutable_volume() = to_proto(*patch.volume);
  write_component(patch.skin, "skin", message,
                  [&](const SkinPatch& p) { *message.mutable_skin() = to_proto(p, sink); });
  write_component(patch.morph_weights, "morph_weights", message, [&](const MorphWeights& w) {
    *message.mutable_morph_weights() = to_proto(w, sink);
  });
  if (patch.label) *message.mutable_label() = to_proto(*patch.label);
  if (patch.visible) message.set_visible(*patch.visible);
  if (patch.visibility) *message.mutable_visibility() = visibility_to_proto(*patch.visibility);
  if (patch.is_static) message.set_static_(*patch.is_static);
  if (patch.shadow_catcher) message.set_shadow_catcher(*patch.shadow_catcher);
  if (patch.teleport) message.set_teleport(true);
  if (patch.attributes)
    message.mutable_attributes()->mutable_values()->insert(patch.attributes->begin(),
                                                           patch.attributes->end());
  if (patch.light_group) message.set_light_group(*patch.light_group);
  return message;
}

}  // namespace heliograph::server
