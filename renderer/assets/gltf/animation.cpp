// Source: glTF 2.0, 3.11 (Animations).
#include "renderer/assets/gltf/animation.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "renderer/assets/curves.h"

namespace heliograph::assets::gltf {
namespace {

class Loader {
 public:
  Loader(const Document& document, Builder& builder, const std::vector<Node>& nodes,
         const Entities& entities, const std::vector<Mesh>& meshes)
      : document_(document),
        builder_(builder),
        nodes_(nodes),
        entities_(entities),
        meshes_(meshes),
        lit_(find_lit(nodes)),
        keys_(builder) {}

  Asset::Animation load(const Value& animation, u32 index) {
    std::map<u32, Track> tracks;
    for (const Value& channel : animation.at("channels").elements())
      add_channel(animation, channel, tracks);
    Asset::Animation result{
        .name = clean_name(animation.text("name", ""), fmt::format("animation_{}", index)),
        .channels = {}};
    for (const auto& [node, track] : tracks) {
      if (track.scale && lit_[node]) {
        builder_.warn(fmt::format("node '{}': lights below its animated scale take that scale",
                                  nodes_[node].name));
      }
      if (track.translation || track.rotation || track.scale) {
        result.channels.push_back(
            {*entities_.node[node], keys_.poses(rest_of(nodes_[node]), track)});
      }
      if (track.weights) {
        result.channels.push_back({*entities_.mesh[node], keys_.weights(*track.weights)});
      }
    }
    return result;
  }

 private:
  /// By index: a node has lights, or one below it.
  static std::vector<bool> find_lit(const std::vector<Node>& nodes) {
    std::vector<bool> lit(nodes.size());
    for (u32 i = 0; i < nodes.size(); ++i) {
      if (!has_lights(nodes[i].value)) continue;
      for (std::optional<u32> at = i; at && !lit[*at]; at = nodes[*at].parent) lit[*at] = true;
    }
    return lit;
  }

  static Rest rest_of(const Node& node) {
    return {.name = node.name,
            .where = node.value.where(),
            .translation = node.translation,
            .rotation = node.rotation,
            .scale = node.scale};
  }

  struct Property {
    u32 node;
    std::string path;
  };

  /// Property that a channel animates; nullopt, with a warning: not a property of a node.
  std::optional<Property> property_of(const Value& target) {
    const std::string path = target.at("path").text();
    if (const auto extension = target.extension("KHR_animation_pointer");
        extension && path == "pointer")
      return pointed(extension->at("pointer"));
    if (const auto node = target.find("node")) return Property{node->index(nodes_.size()), path};
    builder_.warn(fmt::format("animation channels for '{}' are left out", clean_name(path, "?")));
    return std::nullopt;
  }

  /// "/nodes/<index>/translation", or rotation, scale, weights. Source: KHR_animation_pointer.
  std::optional<Property> pointed(const Value& pointer) {
    static constexpr std::array<std::string_view, 4> kPaths = {"translation", "rotation", "scale",
                                                               "weights"};
    constexpr std::string_view kNodes = "/nodes/";
    const std::string text = pointer.text();
    const std::size_t slash = text.rfind('/');
    const std::string path = text.substr(slash + 1);
    if (text.starts_with(kNodes) && slash > kNodes.size() && std::ranges::count(kPaths, path) > 0) {
      u32 node = 0;
      const char* end = text.data() + slash;
      const auto [at, error] = std::from_chars(text.data() + kNodes.size(), end, node);
      if (error == std::errc() && at == end && node < nodes_.size()) return Property{node, path};
      refuse(pointer.where(), fmt::format("names none of the {} nodes", nodes_.size()));
    }
    builder_.warn(
        fmt::format("animation channels for '{}' are left out", clean_text(text, kLongestPointer)));
    return std::nullopt;
  }
  static constexpr std::size_t kLongestPointer = 200;

  void add_channel(const Value& animation, const Value& channel, std::map<u32, Track>& tracks) {
    const Value target = channel.at("target");
    const auto property = property_of(target);
    if (!property || !entities_.node[property->node]) return;
    const auto& [index, path] = *property;
    Track& track = tracks[index];
    std::optional<Curve>* slot = nullptr;
    u32 width = 3;
    if (path == "translation") slot = &track.translation;
    if (path == "scale") slot = &track.scale;
    if (path == "rotation") slot = &track.rotation, width = 4;
    if (path == "weights") slot = &track.weights, width = morph_count(index, target);
    if (!slot) refuse(target.key_where("path"), "must be translation, rotation, scale or weights");
    if (*slot) refuse(channel.where(), "a second channel for the same property");
    if (path != "weights" && nodes_[index].has_matrix) {
      refuse(target.key_where("node"), "an animated node must not have a matrix");
    }
    *slot = read_curve(animation, channel, path, width);
  }

  u32 morph_count(u32 node, const Value& target) const {
    const auto mesh = nodes_[node].value.find("mesh");
    const u32 count = mesh ? meshes_[mesh->index(meshes_.size())].morph_count : 0;
    if (count == 0 || !entities_.mesh[node]) {
      refuse(target.where(), "animates weights, but the node's mesh has no morph targets");
    }
    return count;
  }

  Curve read_curve(const Value& animation, const Value& channel, const std::string& path,
                   u32 width) {
    const Value samplers = animation.at("samplers");
    const Value sampler = samplers[channel.at("sampler").index(samplers.size())];
    const std::string kind = sampler.text("interpolation", "LINEAR");
    Curve curve{.rotation = path == "rotation", .width = width, .times = {}, .values = {}};
    if (kind == "STEP") {
      curve.kind = Curve::Kind::kStep;
    } else if (kind == "CUBICSPLINE") {
      curve.kind = Curve::Kind::kSpline;
    } else if (kind != "LINEAR") {
      refuse(sampler.key_where("interpolation"), "must be STEP, LINEAR or CUBICSPLINE");
    }
    const Value input = sampler.at("input");
    const Value output = sampler.at("output");
    curve.times = read_floats(document_, input, 1, builder_.budget);
    curve.values = read_floats(document_, output, path == "weights" ? 1 : width, builder_.budget);
    if (curve.times.empty()) refuse(input.where(), "has no keys");
    if (std::ranges::adjacent_find(curve.times, std::greater_equal{}) != curve.times.end()) {
      refuse(input.where(), "times must strictly increase");
    }
    const u64 per_key = u64(width) * (curve.kind == Curve::Kind::kSpline ? 3 : 1);
    if (curve.values.size() != curve.times.size() * per_key) {
      refuse(output.where(), fmt::format("has {} numbers, {} keys need {}", curve.values.size(),
                                         curve.times.size(), curve.times.size() * per_key));
    }
    return curve;
  }

  const Document& document_;
  Builder& builder_;
  const std::vector<Node>& nodes_;
  const Entities& entities_;
  const std::vector<Mesh>& meshes_;
  const std::vector<bool> lit_;
  Keys keys_;
};

}  // namespace

std::vector<Asset::Animation> load_animations(const Document& document, Builder& builder,
                                              const std::vector<Node>& nodes,
                                              const Entities& entities,
                                              const std::vector<Mesh>& meshes) {
  std::vector<Asset::Animation> animations;
  Loader loader(document, builder, nodes, entities, meshes);
  for (const Value& animation : document.items("animations"))
    animations.push_back(loader.load(animation, u32(animations.size())));
  return animations;
}

}  // namespace heliograph::assets::gltf
