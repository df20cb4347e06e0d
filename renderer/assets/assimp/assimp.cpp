// FBX, 3DS, 3MF, X, OFF and AMF to an asset: the order of the steps. Chosen by load.cpp.
//
// The root entity is the user's. Below it "z_up" turns the file's axes to +Z up and scales its unit
// to metres; the file's nodes hang below that.
#include "renderer/assets/assimp/scene.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "renderer/assets/lamps.h"
#include "renderer/assets/poses.h"

namespace heliograph::assets {
namespace {

using namespace assimp;

class Maker {
 public:
  Maker(const aiScene& scene, Builder& builder)
      : scene_(scene), builder_(builder), world_(world_from_scene(scene, builder)) {}

  /// Before the library takes names, so that entities have those of the file's nodes.
  void claim_names(const aiNode& node, u32 depth = 0) {
    constexpr u32 kDeepest = 1024;
    if (depth > kDeepest) refuse("nodes", "are nested deeper than 1024");
    const std::string name = text_of(node.mName);
    const bool is_made_up = name.starts_with('<') || name.starts_with('$');
    names_[&node] = builder_.claim_name(is_made_up ? "" : name, "node");
    for (const aiNode* child : std::span(node.mChildren, node.mNumChildren))
      claim_names(*child, depth + 1);
  }

  /// Shapes of all nodes, which are of the library, before the first entity.
  void load_shapes(const aiNode& node, Meshes& meshes) {
    if (node.mNumMeshes > 0) shapes_[&node] = meshes.of(node);
    for (const aiNode* child : std::span(node.mChildren, node.mNumChildren))
      load_shapes(*child, meshes);
  }

  std::map<std::string, Placed> make() {
    z_up_ = builder_.turned_root(world_);
    add(*scene_.mRootNode, z_up_, mat4x3(1));
    for (const Skinned& skinned : skinned_) add_skinned(skinned);
    for (u32 i = 0; i < scene_.mNumLights; ++i) add_light(*scene_.mLights[i]);
    for (u32 i = 0; i < scene_.mNumCameras; ++i) add_camera(*scene_.mCameras[i]);
    return std::move(placed_);
  }

 private:
  struct Skinned {
    std::string name;
    const Shape* shape;
  };

  /// Pose of a node relative to its parent. The pose of an FBX root is in z_up's.
  mat4x3 local_of(const aiNode& node) const {
    if (builder_.format == "fbx" && !node.mParent) return mat4x3(1);
    return matrix_of(node.mTransformation);
  }

  void add(const aiNode& node, u32 parent, const mat4x3& above) {
    const std::string name = text_of(node.mName);
    PutEntity put{.parent = builder_.entity_ref(parent)};
    const std::string what = fmt::format("node '{}'", clean_name(name, "?"));
    const mat4x3 pose = set_pose(put, local_of(node), what, builder_);
    const auto found = shapes_.find(&node);
    const std::vector<const Shape*> none;
    const auto& shapes = found == shapes_.end() ? none : found->second;
    const bool own = shapes.size() == 1 && shapes[0]->joints.empty();
    if (own) show(*shapes[0], put);
    const u32 entity = builder_.entity(names_.at(&node), std::move(put));
    Placed& placed = placed_[name];
    placed = {&node, entity, {}};
    scene_poses_[&node] = affine_product(above, pose);
    if (own && !shapes[0]->morph_weights.empty())
      placed.morphs.emplace_back(entity, shapes[0]->morph_weights);
    for (const Shape* shape : own ? none : shapes) add_below(*shape, name, entity, placed);
    for (const aiNode* child : std::span(node.mChildren, node.mNumChildren))
      add(*child, entity, scene_poses_[&node]);
  }

  void add_below(const Shape& shape, const std::string& name, u32 parent, Placed& placed) {
    if (!shape.joints.empty()) {
      skinned_.push_back({name, &shape});
      return;
    }
    PutEntity put{.parent = builder_.entity_ref(parent)};
    show(shape, put);
    const u32 entity = builder_.entity(builder_.claim_name(name, "mesh"), std::move(put));
    if (!shape.morph_weights.empty()) placed.morphs.emplace_back(entity, shape.morph_weights);
  }

  static void show(const Shape& shape, PutEntity& put) {
    put.mesh = shape.mesh;
    if (!std::ranges::all_of(shape.materials, is_nothing)) put.materials = shape.materials;
    if (!shape.morph_weights.empty())
      put.morph_weights = MorphWeights{.times = {}, .weights = shape.morph_weights};
  }

  /// After all joints. The pose is where the bind pose puts the mesh, so that its box at rest lies
  /// around it.
  void add_skinned(const Skinned& skinned) {
    PutEntity put{.parent = builder_.entity_ref(z_up_)};
    show(*skinned.shape, put);
    SkinPatch skin{.joints = {}, .inverse_binds = skinned.shape->inverse_binds};
    for (std::size_t i = 0; i < skin.inverse_binds.size(); ++i)
      skin.joints.push_back(joint_of(skinned, skinned.shape->joints[i], skin.inverse_binds[i]));
    const mat4x3 bound =
        affine_product(joint_poses_.at(skinned.shape->joints[0]), skin.inverse_binds[0]);
    if (invertible(bound)) put.pose = constant_pose(bound);
    put.skin = std::move(skin);
    const u32 entity =
        builder_.entity(builder_.claim_name(skinned.name + ".skin", "skin"), std::move(put));
    if (!skinned.shape->morph_weights.empty())
      placed_[skinned.name].morphs.emplace_back(entity, skinned.shape->morph_weights);
  }

  /// The node of a bone; one without a node stays where the mesh's has it.
  Ref joint_of(const Skinned& skinned, const std::string& name, const mat4x3& inverse_bind) {
    const auto found = placed_.find(name);
    if (found != placed_.end()) {
      joint_poses_[name] = scene_poses_.at(found->second.node);
      return builder_.entity_ref(found->second.entity);
    }
    const std::string clean = clean_name(name, "?");
    builder_.warn(fmt::format("bone '{}' has no node and stays where it is", clean));
    if (!invertible(inverse_bind))
      refuse(fmt::format("bone '{}'", clean), "its bind pose has no inverse");
    const mat4x3 bind = mat4x3(glm::inverse(mat4(inverse_bind)));
    joint_poses_[name] = affine_product(scene_poses_.at(placed_.at(skinned.name).node), bind);
    return builder_.entity_ref(builder_.entity(
        builder_.claim_name(name, "joint"),
        {.parent = builder_.entity_ref(z_up_), .pose = constant_pose(joint_poses_[name])}));
  }

  /// A frame at `position` whose -Z looks along `direction`.
  static mat4x3 looking(vec3 position, vec3 direction, vec3 up) {
    if (!(glm::length(direction) > 0)) direction = {0, 0, -1};
    const vec3 z = -glm::normalize(direction);
    vec3 x = glm::cross(up, z);
    if (!(glm::length(x) > 1e-6))
      x = glm::cross(std::abs(z.x) < 0.9 ? vec3(1, 0, 0) : vec3(0, 1, 0), z);
    x = glm::normalize(x);
    return {vec3(x), vec3(glm::cross(z, x)), vec3(z), vec3(position)};
  }

  const Placed* placed_by(const aiString& name) const {
    const auto found = placed_.find(text_of(name));
    return found == placed_.end() ? nullptr : &found->second;
  }

  /// The node's frame without its scale, then the lamp's own.
  Place place_of(const Placed& placed, const mat4x3& own) const {
    const mat4x3 scene_from_node = affine_product(world_, scene_poses_.at(placed.node));
    mat4x3 turned = own;
    turned[3] = vec3(0);
    mat4x3 pose = affine_product(unscaled(scene_from_node), turned);
    pose[3] = own[3];
    return {placed.entity, pose};
  }

  void add_light(const aiLight& from) {
    const Placed* placed = placed_by(from.mName);
    const std::string name = clean_name(text_of(from.mName), "light");
    const vec3 color(from.mColorDiffuse.r, from.mColorDiffuse.g, from.mColorDiffuse.b);
    const bool is_sun = from.mType == aiLightSource_DIRECTIONAL;
    if (!placed ||
        (!is_sun && from.mType != aiLightSource_POINT && from.mType != aiLightSource_SPOT)) {
      builder_.warn(fmt::format("light '{}' is neither point, spot nor sun and is left out", name));
      return;
    }
    builder_.warn("lights have no unit: their numbers are taken as candela, of suns as lux");
    Light light;
    if (!is_sun) light = small_sphere();
    light.unit = is_sun ? LightUnit::kIlluminance : LightUnit::kCandela;
    if (is_sun) light.sun_angle = kSunAngle;
    light.color = glm::max(color, vec3(0));
    if (from.mType == aiLightSource_SPOT) {
      const double outer = 0.5 * std::clamp(double(from.mAngleOuterCone), 2e-3, std::numbers::pi);
      light.outer_cone_angle = float(outer);
      light.inner_cone_angle = float(std::clamp(0.5 * double(from.mAngleInnerCone), 0.0, outer));
    }
    const mat4x3 own =
        looking(vector_of(from.mPosition), vector_of(from.mDirection), vector_of(from.mUp));
    put_light(builder_, {.light = light, .texture = {}},
              builder_.claim_name(name + ".light", "light"), place_of(*placed, own));
  }

  void add_camera(const aiCamera& from) {
    const Placed* placed = placed_by(from.mName);
    const std::string name = clean_name(text_of(from.mName), "camera");
    // The whole angle stands there in 3DS, half of it in others.
    const double half = double(from.mHorizontalFOV) * (builder_.format == "3ds" ? 0.5 : 1);
    const bool is_seeing = half > 1e-3 && half < 0.49 * std::numbers::pi;
    if (!placed || (!is_seeing && from.mOrthographicWidth <= 0)) {
      builder_.warn(fmt::format("camera '{}' has no angle of view and is left out", name));
      return;
    }
    const double aspect = from.mAspect > 0 ? double(from.mAspect) : 16.0 / 9.0;
    const mat4x3 own =
        looking(vector_of(from.mPosition), vector_of(from.mLookAt), vector_of(from.mUp));
    const Place place = place_of(*placed, own);
    PutEntity put{.parent = builder_.entity_ref(place.entity), .pose = constant_pose(place.pose)};
    put.camera =
        is_seeing ? perspective_camera(2 * std::atan(std::tan(half) / aspect), aspect)
                  : orthographic_camera(from.mOrthographicWidth, from.mOrthographicWidth / aspect);
    builder_.entity(builder_.claim_name(name + ".camera", "camera"), std::move(put));
  }

  const aiScene& scene_;
  Builder& builder_;
  const mat4x3 world_;
  std::map<const aiNode*, std::string> names_;
  std::map<const aiNode*, std::vector<const Shape*>> shapes_;
  std::map<const aiNode*, mat4x3> scene_poses_;
  std::map<std::string, Placed> placed_;       // by the node's name
  std::map<std::string, mat4x3> joint_poses_;  // scene_from_joint
  std::vector<Skinned> skinned_;
  u32 z_up_ = 0;
};

}  // namespace

void load_assimp(Builder& builder) {
  Assimp::Importer importer;
  const aiScene& scene = import_scene(importer, builder);
  if (scene.mNumMeshes + scene.mNumLights + scene.mNumCameras == 0)
    refuse("", "the file shows no geometry");
  Maker maker(scene, builder);
  maker.claim_names(*scene.mRootNode);
  const std::vector<Ref> materials = load_materials(scene, builder);
  if (!builder.complete()) return;
  Meshes meshes(scene, builder, materials);
  maker.load_shapes(*scene.mRootNode, meshes);
  builder.loaded.asset.animations = load_animations(scene, builder, maker.make());
}

}  // namespace heliograph::assets
