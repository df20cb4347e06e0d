// Components of an entity, for Edits::entity.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/array.h"
#include "heliograph/camera.h"
#include "heliograph/light.h"
#include "heliograph/pose.h"
#include "heliograph/ref.h"

namespace heliograph::client {

/// Joints of a mesh, and (J, 4, 4) joint_from_mesh in the bind pose.
struct Skin {
  std::vector<Ref> joints;
  Array inverse_binds;
};

/// Components that are set change, others stay; reset() goes back to the default.
class Components {
 public:
  /// Relative to the parent, held for ever; or keys by time in seconds.
  Components& transform(const Pose& pose) { return set(&Fields::transform, pose); }
  Components& keys(Keys keys) { return set(&Fields::keys, std::move(keys)); }
  /// Makes this edit's pose a jump: it has no flow over the step.
  Components& teleport(bool v) { return set(&Fields::teleport, v); }
  Components& parent(Ref entity) { return set(&Fields::parent, std::move(entity)); }
  Components& mesh(Ref mesh) { return set(&Fields::mesh, std::move(mesh)); }
  /// Binds one material to all parts, or one per part.
  Components& material(Ref material) { return materials({std::move(material)}); }
  Components& materials(std::vector<Ref> parts) {
    return set(&Fields::materials, std::move(parts));
  }
  Components& camera(Camera camera) { return set(&Fields::camera, std::move(camera)); }
  Components& light(Light light) { return set(&Fields::light, std::move(light)); }
  Components& portal(Portal portal) { return set(&Fields::portal, portal); }
  Components& volume(Ref volume) { return set(&Fields::volume, std::move(volume)); }
  Components& skin(Skin skin) { return set(&Fields::skin, std::move(skin)); }
  Components& morph_weights(std::vector<float> weights) {
    return morph_weights({{0.0, std::move(weights)}}, false);
  }
  Components& morph_weights(std::map<double, std::vector<float>> by_time) {
    return morph_weights(std::move(by_time), true);
  }
  /// 0: none. Without a label, an entity with a category gets the next free one. Label, category,
  /// group and part are one value: give them together. An entity with a part is that part whole.
  Components& label(std::uint32_t label) { return set(&Fields::label, label); }
  Components& category(std::string name) { return set(&Fields::category, std::move(name)); }
  Components& group(bool v) { return set(&Fields::group, v); }
  Components& part(std::uint32_t v) { return set(&Fields::part, v); }
  /// false removes it from every ray and label; visibility() keeps its light.
  Components& visible(bool v) { return set(&Fields::visible, v); }
  Components& visibility(Visibility v) { return set(&Fields::visibility, v); }
  /// Promises that the entity does not move, which makes tracing faster.
  Components& is_static(bool v) { return set(&Fields::is_static, v); }
  Components& shadow_catcher(bool v) { return set(&Fields::shadow_catcher, v); }
  /// The name that all its light counts under in planes "beauty:NAME".
  Components& light_group(std::string name) { return set(&Fields::light_group, std::move(name)); }
  /// Free texts, which travel to the labels.
  Components& attributes(std::map<std::string, std::string> values) {
    return set(&Fields::attributes, std::move(values));
  }

  /// A component by its name in scene.proto ("parent", "pose", "materials") goes back to its
  /// default.
  Components& reset(std::string name) {
    fields_.reset.push_back(std::move(name));
    return *this;
  }

  struct Fields {
    std::optional<Pose> transform{};
    std::optional<Keys> keys{};
    std::optional<bool> teleport{};
    std::optional<Ref> parent{};
    std::optional<Ref> mesh{};
    std::optional<std::vector<Ref>> materials{};
    std::optional<Camera> camera{};
    std::optional<Light> light{};
    std::optional<Portal> portal{};
    std::optional<Ref> volume{};
    std::optional<Skin> skin{};
    std::map<double, std::vector<float>> morph_weights{};
    bool has_morph_times = false;
    std::optional<std::uint32_t> label{};
    std::optional<std::string> category{};
    std::optional<bool> group{};
    std::optional<std::uint32_t> part{};
    std::optional<bool> visible{};
    std::optional<Visibility> visibility{};
    std::optional<bool> is_static{};
    std::optional<bool> shadow_catcher{};
    std::optional<std::string> light_group{};
    std::optional<std::map<std::string, std::string>> attributes{};
    std::vector<std::string> reset{};
  };
  [[nodiscard]] const Fields& fields() const { return fields_; }

 private:
  template <class T, class V>
  Components& set(std::optional<T> Fields::* field, V&& value) {
    fields_.*field = std::forward<V>(value);
    return *this;
  }
  Components& morph_weights(std::map<double, std::vector<float>> weights, bool has_times) {
    fields_.morph_weights = std::move(weights);
    fields_.has_morph_times = has_times;
    return *this;
  }

  Fields fields_;
};

}  // namespace heliograph::client
