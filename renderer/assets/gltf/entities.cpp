// Nodes to entities. Parents come before children and joints before the meshes that follow them, so
// that every reference points back.
#include <algorithm>

#include "renderer/assets/gltf/nodes.h"
#include "renderer/assets/mesh_data.h"
#include "renderer/assets/poses.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets::gltf {
namespace {

class Maker {
 public:
  Maker(const Document& document, Builder& builder, const std::vector<Node>& nodes,
        const Library& library)
      : document_(document), builder_(builder), nodes_(nodes), library_(library) {
    entities_.node.resize(nodes.size());
    entities_.mesh.resize(nodes.size());
    shown_.resize(nodes.size(), true);
    poses_.resize(nodes.size(), mat4x3(1));
  }

  Entities make() {
    const u32 z_up = builder_.turned_root(mat4x3(z_up_from("y")));
    std::vector<u32> order = scene_roots();
    std::vector<u32> skinned;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const Node& node = nodes_[order[i]];
      if (has_skin(node)) skinned.push_back(order[i]);
      add_node(order[i], z_up);
      order.insert(order.end(), node.children.begin(), node.children.end());
    }
    for (const u32 index : skinned) add_skinned(nodes_[index], index, z_up);
    return std::move(entities_);
  }

 private:
  static bool has_skin(const Node& node) {
    return node.value.find("skin") && node.value.find("mesh");
  }

  /// Source: KHR_node_visibility. Of the node alone; those below follow it.
  static bool is_visible(const Node& node) {
    const auto own = node.value.extension("KHR_node_visibility");
    return !own || own->flag("visible", true);
  }

  std::vector<u32> scene_roots() const {
    std::vector<u32> roots;
    if (document_.count("scenes") == 0) {
      for (u32 i = 0; i < nodes_.size(); ++i) {
        if (!nodes_[i].parent) roots.push_back(i);
      }
      return roots;
    }
    const auto chosen = document_.root().find("scene");
    const Value scene = chosen ? document_.named("scenes", *chosen) : document_.item("scenes", 0);
    const auto list = scene.find("nodes");
    if (!list) return roots;
    for (const Value& node : list->elements()) {
      const u32 root = node.index(nodes_.size());
      if (nodes_[root].parent) refuse(node.where(), "is not a root: it has a parent");
      if (std::ranges::count(roots, root)) refuse(node.where(), "is in the scene twice");
      roots.push_back(root);
    }
    return roots;
  }

  PutEntity placed(u32 index, u32 z_up) const {
    const Node& node = nodes_[index];
    const auto parent = node.parent ? entities_.node[*node.parent] : std::optional<u32>(z_up);
    PutEntity put{.parent = builder_.entity_ref(*parent)};
    if (!is_visible(node)) put.visible = false;
    if (!invertible(node.local)) {
      builder_.warn(
          fmt::format("node '{}' has a scale without an inverse and is hidden", node.name));
      put.visible = false;
      put.pose = constant_pose(mat4x3(vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1), node.local[3]));
    } else if (node.local != mat4x3(1)) {
      put.pose = constant_pose(node.local);
    }
    return put;
  }

  const Mesh& mesh_of(const Node& node) const {
    return library_.meshes[node.value.at("mesh").index(library_.meshes.size())];
  }

  /// Binds the node's mesh, its materials and its morph weights.
  void bind_mesh(const Node& node, PutEntity& put) const {
    const Mesh& mesh = mesh_of(node);
    if (std::holds_alternative<std::monostate>(mesh.ref)) return;
    put.mesh = mesh.ref;
    put.materials = mesh.materials;
    if (mesh.morph_count == 0) return;
    std::vector<float> weights = read_weights(node.value, mesh.morph_count);
    if (weights.empty()) weights = mesh.morph_weights;
    weights.resize(mesh.morph_count);
    put.morph_weights = MorphWeights{.times = {}, .weights = std::move(weights)};
  }

  void add_node(u32 index, u32 z_up) {
    const Node& node = nodes_[index];
    PutEntity put = placed(index, z_up);
    shown_[index] = is_visible(node) && (!node.parent || shown_[*node.parent]);
    poses_[index] = node.parent ? affine_product(poses_[*node.parent], node.local) : node.local;
    const bool has_mesh = node.value.find("mesh") && !has_skin(node);
    const auto instancing = node.value.extension("EXT_mesh_gpu_instancing");
    const bool plain = has_mesh && !instancing;
    if (plain) bind_mesh(node, put);
    if (const auto camera = node.value.find("camera"))
      put.camera = read_camera(document_.named("cameras", *camera));
    entities_.node[index] = builder_.entity(node.name, std::move(put));
    if (plain) entities_.mesh[index] = entities_.node[index];
    if (has_mesh && instancing) add_instances(node, *instancing, *entities_.node[index]);
    add_lights(document_, builder_, library_.profiles,
               {.node = node.value, .below = {*entities_.node[index], unscaled(poses_[index])}});
  }

  /// Source: EXT_mesh_gpu_instancing.
  void add_instances(const Node& node, const Value& instancing, u32 parent) {
    const Value attributes = instancing.at("attributes");
    std::optional<u64> count;
    for (const auto& [key, accessor] : attributes.members()) {
      const u64 here = accessor_count(document_, accessor);
      if (count && *count != here) refuse(accessor.where(), "has another count than its siblings");
      count = here;
    }
    const u64 total = count.value_or(0);
    Budget::check(total, builder_.options.limits.entities, "entities", instancing.where());
    std::vector<vec3> translations(total, vec3(0));
    std::vector<vec3> scales(total, vec3(1));
    std::vector<vec4> rotations(total, vec4(0, 0, 0, 1));
    const auto read = [&]<class T>(const std::string& key, std::vector<T>& out) {
      const auto accessor = attributes.find(key);
      if (accessor) out = read_as<T>(document_, *accessor, builder_.budget);
    };
    read("TRANSLATION", translations);
    read("SCALE", scales);
    read("ROTATION", rotations);
    for (std::size_t i = 0; i < total; ++i) {
      const vec4 r = rotations[i];
      const quat rotation = unit_rotation(quat(r.w, r.x, r.y, r.z), instancing.where(), builder_);
      const mat4x3 pose = thickened(compose_trs(translations[i], rotation, scales[i]));
      if (!invertible(pose)) {
        builder_.warn(fmt::format("instances of node '{}' whose scale has no inverse are left out",
                                  node.name));
        continue;
      }
      PutEntity put{.parent = builder_.entity_ref(parent), .pose = constant_pose(pose)};
      bind_mesh(node, put);
      builder_.entity(builder_.claim_name(fmt::format("{}.{}", node.name, i), "instance"),
                      std::move(put));
    }
  }

  /// After all joints, an entity that follows them alone, whatever its node does. Its pose is where
  /// the bind pose puts the mesh's coordinates, so that the box of the rest shape lies around it.
  void add_skinned(const Node& node, u32 index, u32 z_up) {
    PutEntity put{.parent = builder_.entity_ref(z_up)};
    if (!shown_[index]) put.visible = false;
    bind_mesh(node, put);
    put.skin = read_skin_patch(node);
    const mat4x3 bound =
        affine_product(poses_[first_joint(node)], (*put.skin)->inverse_binds.front());
    if (invertible(bound)) put.pose = constant_pose(bound);
    const std::string name = builder_.claim_name(node.name + ".skin", "skin");
    entities_.mesh[index] = builder_.entity(name, std::move(put));
  }

  Value skin_of(const Node& node) const { return document_.named("skins", node.value.at("skin")); }
  u32 first_joint(const Node& node) const {
    return skin_of(node).at("joints")[0].index(nodes_.size());
  }

  SkinPatch read_skin_patch(const Node& node) const {
    const Value skin = skin_of(node);
    SkinData data = read_skin(document_, skin, nodes_.size(), builder_.budget);
    const Mesh& mesh = mesh_of(node);
    if (mesh.joint_count == 0)
      refuse(node.value.where(), "has a skin, but its mesh has no JOINTS_0");
    if (mesh.joint_count > data.joints.size()) {
      refuse(skin.key_where("joints"), fmt::format("the mesh uses joint {}, the skin has {}",
                                                   mesh.joint_count - 1, data.joints.size()));
    }
    SkinPatch patch{.joints = {}, .inverse_binds = std::move(data.inverse_binds)};
    for (const u32 joint : data.joints) {
      if (!entities_.node[joint]) {
        refuse(skin.key_where("joints"), fmt::format("node {} is not in the scene", joint));
      }
      patch.joints.push_back(builder_.entity_ref(*entities_.node[joint]));
    }
    return patch;
  }

  const Document& document_;
  Builder& builder_;
  const std::vector<Node>& nodes_;
  const Library& library_;
  Entities entities_;
  std::vector<mat4x3> poses_;  // scene_from_node, of those in the scene
  std::vector<bool> shown_;    // with all nodes above
};

}  // namespace

Entities make_entities(const Document& document, Builder& builder, const std::vector<Node>& nodes,
                       const Library& library) {
  return Maker(document, builder, nodes, library).make();
}

}  // namespace heliograph::assets::gltf
