// Components to an Entity; lights both ways.
#include <utility>

#include "wire/arrays.h"
#include "wire/convert.h"
#include "wire/session.h"
#include "wire/uploads.h"

namespace heliograph::client::wire {
namespace {

void put_keys(const Keys& keys, Draft& draft, v1::Pose* out) {
  std::vector<double> times;
  std::vector<Pose> poses;
  for (const auto& [time, pose] : keys) {
    times.push_back(time);
    poses.push_back(pose);
  }
  put_inline(Array(std::move(times)), out->mutable_times());
  put_edited(as_f32(Array(std::move(poses)), "keys"), draft, out->mutable_matrices());
}

void put_morph_weights(const Components::Fields& given, v1::MorphWeights* out) {
  std::vector<double> times;
  std::vector<float> rows;
  const std::size_t targets = given.morph_weights.begin()->second.size();
  for (const auto& [time, row] : given.morph_weights) {
    times.push_back(time);
    rows.insert(rows.end(), row.begin(), row.end());
  }
  if (rows.size() != times.size() * targets)
    throw ClientError(Code::kInvalidArgument,
                      "morph_weights: rows differ in length; give one weight a target",
                      {"morph_weights"});
  if (!given.has_morph_times) return put_inline(Array(std::move(rows)), out->mutable_weights());
  put_inline(Array(std::move(rows), {times.size(), targets}), out->mutable_weights());
  put_inline(Array(std::move(times)), out->mutable_times());
}

void put_bindings(const Components::Fields& given, Draft& draft, v1::Entity* out) {
  if (given.parent) put_ref(*given.parent, &draft, "parent", out->mutable_parent());
  if (given.mesh) put_ref(*given.mesh, &draft, "mesh", out->mutable_mesh());
  if (given.volume) put_ref(*given.volume, &draft, "volume", out->mutable_volume());
  if (given.materials) {
    out->mutable_materials();
    for (const Ref& part : *given.materials)
      put_ref(part, &draft, "materials", out->mutable_materials()->add_parts());
  }
  if (given.skin) {
    for (const Ref& joint : given.skin->joints)
      put_ref(joint, &draft, "skin", out->mutable_skin()->add_joints());
    put_inline(given.skin->inverse_binds, out->mutable_skin()->mutable_inverse_binds());
  }
  if (!given.morph_weights.empty()) put_morph_weights(given, out->mutable_morph_weights());
}

void put_flags(const Components::Fields& given, v1::Entity* out) {
  if (given.teleport) out->set_teleport(*given.teleport);
  if (given.visible) out->set_visible(*given.visible);
  if (given.is_static) out->set_static_(*given.is_static);
  if (given.shadow_catcher) out->set_shadow_catcher(*given.shadow_catcher);
  if (given.light_group) out->set_light_group(*given.light_group);
  if (given.visibility) {
    v1::Visibility* to = out->mutable_visibility();
    to->set_camera(given.visibility->camera);
    to->set_diffuse(given.visibility->diffuse);
    to->set_glossy(given.visibility->glossy);
    to->set_transmission(given.visibility->transmission);
    to->set_shadow(given.visibility->shadow);
    to->set_volume(given.visibility->volume);
  }
  if (given.attributes) {
    auto& to = *out->mutable_attributes()->mutable_values();
    for (const auto& [key, value] : *given.attributes) to[key] = value;
  }
}

}  // namespace

v1::Vec3 to_proto(Vec3 v) {
  v1::Vec3 out;
  out.set_x(float(v.x));
  out.set_y(float(v.y));
  out.set_z(float(v.z));
  return out;
}

v1::Vec3 to_proto(Color c) { return to_proto(Vec3{c.r, c.g, c.b}); }

void put_matrix(const Mat4& matrix, v1::Array* out) {
  put_inline(as_f32(Array::borrow(matrix.rows[0].data(), {4, 4}), "matrix"), out);
}

void put_pose(const Pose& pose, v1::Pose* out) { put_matrix(pose.matrix, out->mutable_matrices()); }

void put_texture_use(const TextureUse& use, const Draft& draft, const std::string& field,
                     v1::TextureUse* out) {
  put_ref(use.texture, &draft, field, out->mutable_texture());
  out->set_scale(float(use.scale));
  out->set_offset(float(use.offset));
  out->set_uv_set(use.uv_set);
  if (use.channel != 0) out->set_channel(use.channel);
  if (use.uv)
    put_inline(Array::borrow(use.uv->rows[0].data(), {2, 3}), out->mutable_uv_transform());
}

void put_label(const Components::Fields& given, v1::Entity* out) {
  if (!given.label && !given.category && !given.group && !given.part) return;
  v1::Label* to = out->mutable_label();
  if (given.label) to->set_value(*given.label);
  if (given.category) to->set_category(*given.category);
  if (given.group) to->set_group(*given.group);
  if (given.part) to->set_part(*given.part);
}

void put_entity(const Components& components, Draft& draft, v1::Entity* out) {
  const Components::Fields& given = components.fields();
  if (given.transform && given.keys)
    throw ClientError(Code::kInvalidArgument, "keys: give transform or keys, not both", {"keys"});
  if (given.transform) put_pose(*given.transform, out->mutable_pose());
  if (given.keys) put_keys(*given.keys, draft, out->mutable_pose());
  put_bindings(given, draft, out);
  if (given.camera) put_camera(*given.camera, draft, out->mutable_camera());
  if (given.light) put_light(*given.light, draft, out->mutable_light());
  if (given.portal) {
    out->mutable_portal()->set_width(float(given.portal->width));
    out->mutable_portal()->set_height(float(given.portal->height));
  }
  put_flags(given, out);
  put_label(given, out);
  for (const std::string& name : given.reset) out->add_clear(name);
}

void put_light(const Light& light, const Draft& draft, v1::Light* out) {
  *out->mutable_color() = to_proto(light.color);
  out->set_intensity(float(light.intensity));
  out->set_unit(v1::Light::Unit(light.unit));
  out->set_exposure(float(light.exposure));
  out->set_temperature(float(light.temperature));
  out->set_two_sided(light.two_sided);
  if (light.sun_angle != 0) out->set_sun_angle(float(light.sun_angle));
  if (light.inner_cone_angle != 0) out->set_inner_cone_angle(float(light.inner_cone_angle));
  if (light.outer_cone_angle != 0) out->set_outer_cone_angle(float(light.outer_cone_angle));
  if (light.radius) out->set_radius(float(*light.radius));
  if (light.width) out->set_width(float(*light.width));
  if (light.height) out->set_height(float(*light.height));
  if (light.shape != Light::Shape::kMesh) out->set_shape(v1::Light::Shape(light.shape));
  if (light.texture)
    put_texture_use(*light.texture, draft, "light.texture", out->mutable_texture());
  if (light.profile) put_ref(*light.profile, &draft, "light.profile", out->mutable_profile());
}

Light light_of(const v1::Light& message) {
  Light out;
  out.intensity = message.intensity();
  if (message.unit() != 0) out.unit = Light::Unit(message.unit());
  if (message.has_color()) out.color = to_color(message.color());
  out.exposure = message.exposure();
  out.temperature = message.temperature();
  out.two_sided = message.two_sided();
  out.sun_angle = message.sun_angle();
  out.inner_cone_angle = message.inner_cone_angle();
  out.outer_cone_angle = message.outer_cone_angle();
  if (message.has_radius()) out.radius = message.radius();
  if (message.has_width()) out.width = message.width();
  if (message.has_height()) out.height = message.height();
  if (message.shape() != 0) out.shape = Light::Shape(message.shape());
  return out;
}

}  // namespace heliograph::client::wire
