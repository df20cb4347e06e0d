// Handles ask the daemon.
#include "heliograph/handles.h"

#include <algorithm>
#include <utility>

#include "wire/arrays.h"
#include "wire/assets.h"
#include "wire/convert.h"
#include "wire/read.h"

namespace heliograph::client {
namespace {

using wire::Node;

const std::shared_ptr<Node>& checked(const std::shared_ptr<Node>& node) {
  if (node != nullptr) return node;
  throw ClientError(Code::kFailedPrecondition,
                    "this handle is empty; take one from an edit or a scene");
}

Array array_of(const Handle& handle, const std::string& field) {
  return wire::read(handle, field).array.value_or(Array());
}

v1::Entity entity_of(const Entity& entity) {
  const wire::Found found = wire::read(entity, "entity");
  return found.object ? found.object->entity() : v1::Entity();
}

/// The object that a reference names; none for id 0.
template <class T>
std::optional<T> bound(const Handle& from, bool is_set, const v1::Ref& ref) {
  if (!is_set || ref.id() == 0) return std::nullopt;
  return T(wire::make_node(from.node()->scene, T::kKind, "", ref.id()));
}

template <class T>
T named(const std::vector<std::shared_ptr<Node>>& nodes,
        const google::protobuf::RepeatedPtrField<std::string>& names, const std::string& name) {
  const std::vector<std::string> known(names.begin(), names.end());
  return T(nodes[wire::known(known, name, "name")]);
}

std::array<Vec3, 2> corners_of(const Array& array) {
  const auto at = wire::as_f32(array, "aabb").view<float>();
  return {{{at[0], at[1], at[2]}, {at[3], at[4], at[5]}}};
}

}  // namespace

std::uint64_t Handle::id() const {
  Node& node = *checked(node_);
  if (node.id == 0) {
    if (node.is_made || node.name.empty())
      throw ClientError(Code::kFailedPrecondition, "\"" + node.name +
                                                       "\" does not exist yet; commit its "
                                                       "transaction, and wait for its receipt");
    node.id = node.scene->resolve(node.name);
  }
  return node.id;
}

const std::string& Handle::name() const { return checked(node_)->name; }
Kind Handle::kind() const { return checked(node_)->kind; }

// ---------------------------------------------------------------- entities

Mat4 Entity::transform() const { return wire::matrix_of<Mat4>(array_of(*this, "pose")); }
Mat4 Entity::world_transform() const {
  return wire::matrix_of<Mat4>(array_of(*this, "world_pose"));
}

std::optional<std::array<Vec3, 2>> Entity::aabb() const {
  const Array found = array_of(*this, "aabb");
  if (found.empty()) return std::nullopt;
  return corners_of(found);
}

std::optional<Entity> Entity::parent() const {
  const v1::Entity message = entity_of(*this);
  return bound<Entity>(*this, message.has_parent(), message.parent());
}

std::optional<Mesh> Entity::mesh() const {
  const v1::Entity message = entity_of(*this);
  return bound<Mesh>(*this, message.has_mesh(), message.mesh());
}

std::vector<Material> Entity::materials() const {
  std::vector<Material> out;
  const v1::Entity message = entity_of(*this);
  for (const v1::Ref& part : message.materials().parts())
    out.push_back(bound<Material>(*this, true, part).value_or(Material()));
  return out;
}

bool Entity::visible() const {
  const v1::Entity message = entity_of(*this);
  return !message.has_visible() || message.visible();
}

Camera Entity::camera() const {
  const v1::Entity message = entity_of(*this);
  if (!message.has_camera())
    throw ClientError(Code::kNotFound, "\"" + name() +
                                           "\" has no camera; give it one with "
                                           "Components::camera()");
  Camera camera = wire::camera_of(message.camera());
  if (message.camera().has_rays())
    camera.rays = RayTable{array_of(*this, "camera.rays"), array_of(*this, "camera.times"),
                           message.camera().rays().interpolated()};
  return camera;
}

std::optional<Light> Entity::light() const {
  const v1::Entity message = entity_of(*this);
  if (!message.has_light()) return std::nullopt;
  const v1::Light& light = message.light();
  Light out = wire::light_of(light);
  out.profile = bound<Texture>(*this, light.has_profile(), light.profile());
  const v1::TextureUse& use = light.texture();
  if (const auto texture = bound<Texture>(*this, use.has_texture(), use.texture())) {
    out.texture = TextureUse(*texture);
    out.texture->channel = use.channel();
    out.texture->scale = use.scale();
    out.texture->offset = use.offset();
    out.texture->uv_set = use.uv_set();
    if (use.has_uv_transform())
      out.texture->uv = wire::matrix_of<Matrix<float, 2, 3>>(wire::array_of(use.uv_transform()));
  }
  return out;
}

std::optional<Portal> Entity::portal() const {
  const v1::Entity message = entity_of(*this);
  if (!message.has_portal()) return std::nullopt;
  return Portal{message.portal().width(), message.portal().height()};
}

std::string Entity::light_group() const { return entity_of(*this).light_group(); }

std::map<std::string, std::string> Entity::attributes() const {
  const v1::Entity message = entity_of(*this);
  const auto& values = message.attributes().values();
  return {values.begin(), values.end()};
}

// ---------------------------------------------------------------- meshes, materials

Array Mesh::positions() const { return array_of(*this, "mesh.positions"); }
Array Mesh::indices() const { return array_of(*this, "mesh.indices"); }
Array Mesh::normals() const { return array_of(*this, "mesh.normals"); }
Array Mesh::uvs() const { return array_of(*this, "mesh.uvs"); }

std::map<std::string, Color> Material::parameters() const {
  const wire::Found found = wire::read(*this, "material");
  std::map<std::string, Color> out;
  if (!found.object) return out;
  const v1::Material& message = found.object->material();
  const auto* reflection = message.GetReflection();
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection->ListFields(message, &fields);
  for (const auto* field : fields) {
    if (field->message_type() == v1::ScalarParameter::descriptor())
      out[field->name()] = double(
          static_cast<const v1::ScalarParameter&>(reflection->GetMessage(message, field)).value());
    else if (field->message_type() == v1::ColorParameter::descriptor())
      out[field->name()] = wire::to_color(
          static_cast<const v1::ColorParameter&>(reflection->GetMessage(message, field)).value());
  }
  return out;
}

// ---------------------------------------------------------------- assets

const std::string& Asset::name() const { return state_->name; }

Group Asset::entities() const {
  if (state_->placed.empty())
    throw ClientError(Code::kFailedPrecondition,
                      "\"" + name() + "\" is placed nowhere; use Edits::instance()");
  return state_->placed.front();
}

Entity Asset::root() const { return entities().front(); }

Group Asset::roots() const {
  Group out;
  for (const Group& placed : state_->placed) out.push_back(placed.front());
  return out;
}

Group Asset::cameras() const {
  Group out;
  const Group all = entities();
  const auto& with_camera = state_->info.cameras();
  for (int i = 0; i < state_->info.entities_size(); ++i)
    if (std::find(with_camera.begin(), with_camera.end(), state_->info.entities(i)) !=
        with_camera.end())
      out.push_back(all[std::size_t(i)]);
  return out;
}

Mesh Asset::mesh(const std::string& name) const {
  return named<Mesh>(state_->meshes, state_->info.meshes(), name);
}
Material Asset::material(const std::string& name) const {
  return named<Material>(state_->material_nodes, state_->info.materials(), name);
}
Texture Asset::texture(const std::string& name) const {
  return named<Texture>(state_->textures, state_->info.textures(), name);
}

const std::vector<std::string>& Asset::materials() const { return state_->materials; }
const std::vector<std::string>& Asset::animations() const { return state_->animations; }
const std::vector<std::string>& Asset::warnings() const { return state_->warnings; }

std::optional<std::array<Vec3, 2>> Asset::bounds() const {
  if (!state_->info.has_bounds()) return std::nullopt;
  return corners_of(wire::array_of(state_->info.bounds()));
}

}  // namespace heliograph::client
