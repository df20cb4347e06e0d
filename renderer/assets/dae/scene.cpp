// The scene's nodes, walked down to the geometries they show. Source: COLLADA 1.5.0, chapter 5.
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/poses.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr u32 kDeepest = 128;  // nodes within nodes, by instances too

class Walker {
 public:
  Walker(const Document& document, Builder& builder) : document_(document), builder_(builder) {}

  std::vector<Shown> walk() {
    const Node root = document_.root();
    const Node instance = root.child("scene").child("instance_visual_scene");
    const Node scene =
        instance ? document_.linked(instance.attribute("url").value(), "visual_scene", "scene")
                 : root.child("library_visual_scenes").child("visual_scene");
    if (!scene) refuse("library_visual_scenes", "the file has no scene; export its objects");
    for (const Node& node : scene.children("node")) visit(node, mat4x3(1), 0);
    if (root.child("library_animations").child("animation"))
      builder_.warn("COLLADA animations are left out");
    return std::move(shown_);
  }

 private:
  void visit(const Node& node, const mat4x3& above, u32 depth) {
    Budget::check(++visited_, builder_.options.limits.entities, "nodes", "nodes");
    if (depth > kDeepest)
      refuse(place(node), "is nested deeper than 128 nodes, or is within itself");
    mat4x3 pose = above;
    for (const Node& child : node.children()) {
      const std::string_view tag = child.name();
      if (const auto step = transform(tag, child)) {
        pose = affine_product(pose, *step);
      } else if (tag == "instance_geometry") {
        show(node, child, geometry_of(child, node), pose);
      } else if (tag == "instance_controller") {
        show_at_rest(node, child, pose);
      } else if (tag == "node") {
        visit(child, pose, depth + 1);
      } else if (tag == "instance_node") {
        visit(document_.linked(child.attribute("url").value(), "node", place(node)), pose,
              depth + 1);
      } else if (tag.starts_with("instance_")) {
        builder_.warn(fmt::format("COLLADA {} is left out: {}", clean_name(tag, "?"), place(node)));
      }
    }
  }

  std::vector<float> numbers(const Node& node, std::size_t count) {
    return read_floats(node, count, builder_.budget);
  }

  static mat4x3 matrix(std::span<const float> m, const Node& node) {
    constexpr float kRounding = 1e-5f;
    const vec4 off(m[12], m[13], m[14], m[15] - 1);
    if (glm::any(glm::greaterThan(glm::abs(off), vec4(kRounding))))
      refuse(place(node), "the last row of a matrix must be 0 0 0 1");
    return mat4x3(m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10], m[3], m[7], m[11]);
  }

  /// parent_from_child of one transformation; nullopt: the element is none.
  std::optional<mat4x3> transform(std::string_view tag, const Node& node) {
    if (tag == "matrix") return matrix(numbers(node, 16), node);
    if (tag == "translate") {
      const auto t = numbers(node, 3);
      return mat4x3(glm::translate(mat4(1), vec3(t[0], t[1], t[2])));
    }
    if (tag == "scale") {
      const auto s = numbers(node, 3);
      return mat4x3(glm::scale(mat4(1), vec3(s[0], s[1], s[2])));
    }
    if (tag == "rotate") {
      const auto r = numbers(node, 4);
      const glm::dvec3 axis(r[0], r[1], r[2]);
      if (glm::length(axis) == 0) return mat4x3(1);
      return mat4x3(mat4(glm::rotate(glm::dmat4(1), glm::radians(double(r[3])), axis)));
    }
    if (tag == "lookat" || tag == "skew")
      refuse_unimplemented(place(node), fmt::format("<{}>; export matrices", tag));
    return std::nullopt;
  }

  Node geometry_of(const Node& instance, const Node& node) const {
    return document_.linked(instance.attribute("url").value(), "geometry", place(node));
  }

  // ---------------------------------------------------------------- skins and morph targets

  /// What a controller deforms, as its first joint has it.
  void show_at_rest(const Node& node, const Node& instance, const mat4x3& pose) {
    const std::string where = place(node);
    builder_.warn("COLLADA skins and morph targets do not move: they are shown at rest");
    Node controller = document_.linked(instance.attribute("url").value(), "controller", where);
    mat4x3 placed = pose;
    for (u32 depth = 0;; ++depth) {
      const Node skin = controller.child("skin");
      if (skin) placed = scene_from_skinned(skin);
      const std::string_view source =
          (skin ? skin : controller.child("morph")).attribute("source").value();
      const Node geometry = document_.find(source.substr(source.starts_with('#')), "geometry");
      if (geometry) return show(node, instance, geometry, placed);
      if (depth == kDeepest) refuse(where, "its controllers are within each other");
      controller = document_.linked(source, "controller", where);
    }
  }

  mat4x3 scene_from_skinned(const Node& skin) {
    const Node bind = skin.child("bind_shape_matrix");
    const mat4x3 bound = bind ? matrix(numbers(bind, 16), bind) : mat4x3(1);
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
    const mat4x3 scene_from_bound = affine_product(scene_from(joint), matrix(all, inverse_binds));
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
        if (const auto step = transform(child.name(), child)) local = affine_product(local, *step);
      pose = affine_product(local, pose);
    }
    return pose;
  }

  // ---------------------------------------------------------------- geometries

  void show(const Node& node, const Node& instance, const Node& geometry, const mat4x3& pose) {
    const std::string where = place(node);
    for (int column = 0; column < 4; ++column)
      if (!std::isfinite(glm::dot(pose[column], vec3(1))))
        refuse(where, "its transforms reach beyond what f32 can hold");
    const auto thick = with_thickness(pose);
    if (!thick) {
      builder_.warn(fmt::format("{} has a scale without an inverse and is left out", where));
      return;
    }
    if (*thick != pose)
      builder_.warn(fmt::format("{} has a scale of 0 along one axis and is kept flat", where));
    const std::string_view name = node.attribute("name").value();
    Shown out{.geometry = geometry,
              .name = std::string(name.empty() ? node.attribute("id").value() : name),
              .pose = *thick,
              .material = {}};
    const Node bound = instance.child("bind_material").child("technique_common");
    for (const Node& material : bound.children("instance_material")) {
      const std::string_view target = material.attribute("target").value();
      const Node found = document_.find(target.substr(target.starts_with('#')), "material");
      if (!found)
        builder_.warn(fmt::format("{}: there is no <material> '{}'; the default is used", where,
                                  clean_name(target, "?")));
      out.material[material.attribute("symbol").value()] = found;
    }
    shown_.push_back(std::move(out));
  }

  const Document& document_;
  Builder& builder_;
  std::vector<Shown> shown_;
  std::unordered_map<std::string_view, Node> joints_;
  u64 visited_ = 0;
};

}  // namespace

std::vector<Shown> read_scene(const Document& document, Builder& builder) {
  return Walker(document, builder).walk();
}

}  // namespace heliograph::assets::dae
