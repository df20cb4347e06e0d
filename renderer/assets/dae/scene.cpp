// The scene's nodes, walked down to the geometries they show. Source: COLLADA 1.5.0, chapter 5.
#include "renderer/assets/dae/document.h"
#include "renderer/assets/dae/transforms.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr u32 kDeepest = 128;  // nodes within nodes, by instances too

class Walker {
 public:
  Walker(const Document& document, Builder& builder) : document_(document), builder_(builder) {}

  Scene walk() {
    const Node root = document_.root();
    const Node instance = root.child("scene").child("instance_visual_scene");
    const Node scene =
        instance ? document_.linked(instance.attribute("url").value(), "visual_scene", "scene")
                 : root.child("library_visual_scenes").child("visual_scene");
    if (!scene) refuse("library_visual_scenes", "the file has no scene; export its objects");
    for (const Node& node : scene.children("node")) visit(node, {});
    return std::move(scene_);
  }

 private:
  struct Above {
    std::optional<u32> node;
    mat4x3 pose{1};
    u32 depth = 0;
  };

  void visit(const Node& node, const Above& above) {
    const auto index = u32(scene_.nodes.size());
    Budget::check(u64(index) + 1, builder_.options.limits.entities, "nodes", "nodes");
    if (above.depth > kDeepest)
      refuse(place(node), "is nested deeper than 128 nodes, or is within itself");
    scene_.nodes.push_back({.node = node, .parent = above.node});
    mat4x3 pose = above.pose, own(1);
    for (const Node& child : node.children()) {
      const std::string_view tag = child.name();
      if (const auto step = transform_of(child, builder_.budget)) {
        pose = affine_product(pose, *step);
        own = affine_product(own, *step);
      } else if (tag == "instance_geometry") {
        show(
            child,
            {.geometry = geometry_of(child, node), .pose = pose, .node = index, .instance = child});
      } else if (tag == "instance_controller") {
        show_deformed(child, {.pose = pose, .node = index, .instance = child});
      } else if (tag == "node") {
        visit(child, {index, pose, above.depth + 1});
      } else if (tag == "instance_node") {
        visit(document_.linked(child.attribute("url").value(), "node", place(node)),
              {index, pose, above.depth + 1});
      } else if (tag.starts_with("instance_")) {
        builder_.warn(fmt::format("COLLADA {} is left out: {}", clean_name(tag, "?"), place(node)));
      }
    }
    scene_.nodes[index].pose = own;
    scene_.nodes[index].end = u32(scene_.nodes.size());
  }

  Node geometry_of(const Node& instance, const Node& node) const {
    return document_.linked(instance.attribute("url").value(), "geometry", place(node));
  }

  // ---------------------------------------------------------------- skins and morph targets

  /// Shows what a controller deforms; where nothing states how, as its first joint has it.
  void show_deformed(const Node& instance, Shown shown) {
    const std::string where = place(instance.parent());
    Node controller = document_.linked(instance.attribute("url").value(), "controller", where);
    for (u32 depth = 0; !shown.geometry; ++depth) {
      if (depth > kDeepest) refuse(where, "its controllers are within each other");
      const Node skin = controller.child("skin"), morph = controller.child("morph");
      if (skin && !shown.skin) take_skin(skin, shown);
      if (!shown.morph && input_of(morph.child("targets"), "MORPH_TARGET")) shown.morph = morph;
      const std::string_view source = (skin ? skin : morph).attribute("source").value();
      shown.geometry = document_.find(source.substr(source.starts_with('#')), "geometry");
      if (!shown.geometry) controller = document_.linked(source, "controller", where);
    }
    if (!shown.skin && !shown.morph)
      builder_.warn("COLLADA skins and morph targets do not move: they are shown at rest");
    show(instance, std::move(shown));
  }

  void take_skin(const Node& skin, Shown& shown) {
    if (skin.child("vertex_weights")) {
      shown.skin = skin;
    } else {
      shown.pose = scene_from_skinned(skin);
      shown.stands = true;
    }
  }

  mat4x3 scene_from_skinned(const Node& skin) {
    const Node bind = skin.child("bind_shape_matrix");
    const mat4x3 bound = bind ? matrix_of(read_floats(bind, 16, builder_.budget), bind) : mat4x3(1);
    Node names, inverse_binds;
    for (const Node& input : skin.child("joints").children("input")) {
      const std::string_view semantic = input.attribute("semantic").value();
      const Node source =
          document_.linked(input.attribute("source").value(), "source", place(skin));
      if (semantic == "JOINT") names = source.find_child(is_names);
      if (semantic == "INV_BIND_MATRIX") inverse_binds = source.child("float_array");
    }
    std::string_view list = names.text().get();
    const Node joint = joint_of(take_word(list));
    const std::vector<float> all = read_floats(inverse_binds, builder_.budget);
    if (!joint || all.size() < 16) return bound;
    const mat4x3 scene_from_bound =
        affine_product(scene_from(joint), matrix_of(all, inverse_binds));
    return affine_product(scene_from_bound, bound);
  }

  static bool is_names(const Node& node) {
    return std::string_view(node.name()) == "Name_array" ||
           std::string_view(node.name()) == "IDREF_array";
  }

  /// The first node of the scenes that has the name as its sid or id; null: none has.
  Node joint_of(std::string_view name) {
    if (joints_.empty())
      document_.root().child("library_visual_scenes").find_node([&](const Node& node) {
        if (std::string_view(node.name()) == "node")
          for (const char* key : {"sid", "id"})
            joints_.try_emplace(node.attribute(key).value(), node);
        return false;
      });
    const auto found = joints_.find(name);
    return found == joints_.end() ? Node() : found->second;
  }

  mat4x3 scene_from(Node node) {
    mat4x3 pose(1);
    for (; std::string_view(node.name()) == "node"; node = node.parent()) {
      mat4x3 local(1);
      for (const Node& child : node.children())
        if (const auto step = transform_of(child, builder_.budget))
          local = affine_product(local, *step);
      pose = affine_product(local, pose);
    }
    return pose;
  }

  // ---------------------------------------------------------------- geometries

  void show(const Node& instance, Shown out) {
    const Node node = instance.parent();
    const std::string where = place(node);
    check_finite(out.pose, node);
    out.name = name_of(node);
    const Node bound = instance.child("bind_material").child("technique_common");
    for (const Node& material : bound.children("instance_material")) {
      const std::string_view target = material.attribute("target").value();
      const Node found = document_.find(target.substr(target.starts_with('#')), "material");
      if (!found)
        builder_.warn(fmt::format("{}: there is no <material> '{}'; the default is used", where,
                                  clean_name(target, "?")));
      out.material[material.attribute("symbol").value()] = found;
    }
    scene_.shown.push_back(std::move(out));
  }

  const Document& document_;
  Builder& builder_;
  Scene scene_;
  std::unordered_map<std::string_view, Node> joints_;
};

}  // namespace

Scene read_scene(const Document& document, Builder& builder) {
  return Walker(document, builder).walk();
}

}  // namespace heliograph::assets::dae
