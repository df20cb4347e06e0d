// Source: glTF 2.0, 3.11 (Animations) and appendix C (interpolation).
//
// Our keys interpolate translation and stretch linearly and rotation by slerp, so LINEAR channels
// keep their own times. STEP gets a second key just before each jump; CUBICSPLINE is resampled.
#include "renderer/assets/gltf/animation.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <set>

#include "renderer/scene/invertible.h"

namespace heliograph::assets::gltf {
namespace {

constexpr double kJump = 1e-5;  // seconds a STEP takes
constexpr double kSplineStep = 1 / 60.0;
constexpr int kMostSplineSteps = 64;  // of one segment

/// A sampler: `width` floats at each key; splines have in-tangent, value, out-tangent.
struct Curve {
  enum class Kind : u8 { kStep, kLinear, kSpline } kind = Kind::kLinear;
  bool rotation = false;
  u32 width = 0;
  std::vector<float> times;
  std::vector<float> values;

  [[nodiscard]] const float* value(std::size_t key) const {
    return values.data() + (kind == Kind::kSpline ? 3 * key + 1 : key) * width;
  }
  [[nodiscard]] const float* in_tangent(std::size_t key) const { return value(key) - width; }
  [[nodiscard]] const float* out_tangent(std::size_t key) const { return value(key) + width; }

  /// The times at which our keys must lie.
  void add_times(std::set<double>& out) const {
    for (std::size_t k = 0; k < times.size(); ++k) {
      out.insert(times[k]);
      if (k == 0) continue;
      const double span = double(times[k]) - times[k - 1];
      if (kind == Kind::kStep) out.insert(times[k] - std::min(kJump, span / 2));
      if (kind != Kind::kSpline) continue;
      const int steps = std::clamp(int(std::ceil(span / kSplineStep)), 2, kMostSplineSteps);
      for (int i = 1; i < steps; ++i) out.insert(times[k - 1] + span * i / steps);
    }
  }
  void evaluate(double time, float* out) const;
};

void slerp(const float* a, const float* b, float u, float* out) {
  const quat q = glm::slerp(quat(a[3], a[0], a[1], a[2]), quat(b[3], b[0], b[1], b[2]), u);
  out[0] = q.x, out[1] = q.y, out[2] = q.z, out[3] = q.w;
}

void Curve::evaluate(double time, float* out) const {
  const auto after = std::upper_bound(times.begin(), times.end(), float(time));
  const std::size_t next = std::size_t(after - times.begin());
  if (next == 0 || next == times.size()) {
    std::copy_n(value(next == 0 ? 0 : next - 1), width, out);
    return;
  }
  const std::size_t last = next - 1;
  const double span = double(times[next]) - times[last];
  const auto u = float((time - times[last]) / span);
  if (kind == Kind::kStep) {
    std::copy_n(value(last), width, out);
  } else if (kind == Kind::kLinear && rotation) {
    slerp(value(last), value(next), u, out);
  } else if (kind == Kind::kLinear) {
    for (u32 i = 0; i < width; ++i) out[i] = std::lerp(value(last)[i], value(next)[i], u);
  } else {
    const float u2 = u * u;
    const float u3 = u2 * u;
    for (u32 i = 0; i < width; ++i) {
      out[i] = (2 * u3 - 3 * u2 + 1) * value(last)[i] +
               float(span) * (u3 - 2 * u2 + u) * out_tangent(last)[i] +
               (3 * u2 - 2 * u3) * value(next)[i] + float(span) * (u3 - u2) * in_tangent(next)[i];
    }
  }
}

/// The curves of one node.
struct Track {
  std::optional<Curve> translation, rotation, scale, weights;
};

class Loader {
 public:
  Loader(const Document& document, Builder& builder, const std::vector<Node>& nodes,
         const Entities& entities, const std::vector<Mesh>& meshes)
      : document_(document),
        builder_(builder),
        nodes_(nodes),
        entities_(entities),
        meshes_(meshes),
        lit_(find_lit(nodes)) {}

  Asset::Animation load(const Value& animation, u32 index) {
    std::map<u32, Track> tracks;
    const Value channels = animation.at("channels");
    for (std::size_t i = 0; i < channels.size(); ++i) add_channel(animation, channels[i], tracks);
    Asset::Animation result{
        .name = clean_name(animation.text("name", ""), fmt::format("animation_{}", index)),
        .channels = {}};
    for (const auto& [node, track] : tracks) {
      if (track.scale && lit_[node]) {
        builder_.warn(fmt::format("node '{}': lights below its animated scale take that scale",
                                  nodes_[node].name));
      }
      if (track.translation || track.rotation || track.scale) {
        result.channels.push_back({*entities_.node[node], poses(nodes_[node], track)});
      }
      if (track.weights) {
        result.channels.push_back({*entities_.mesh[node], weights(*track.weights)});
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

  struct Property {
    u32 node;
    std::string path;
  };

  /// What a channel animates; nullopt, with a warning: not a property of a node.
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

  /// Our key times: strictly increasing, and counted.
  std::vector<Time> key_times(std::initializer_list<const std::optional<Curve>*> curves) {
    std::set<double> all;
    for (const auto* curve : curves) {
      if (*curve) (*curve)->add_times(all);
    }
    keys_ += all.size();
    Budget::check(keys_, builder_.options.limits.keys, "animation keys", "animations");
    std::vector<Time> times;
    for (const double time : all) {
      if (times.empty() || time > times.back()) times.push_back(time);
    }
    return times;
  }

  PosePatch poses(const Node& node, const Track& track) {
    PosePatch patch{.times = key_times({&track.translation, &track.rotation, &track.scale}),
                    .matrices = {}};
    builder_.budget.take(patch.times.size(), sizeof(mat4x3) + sizeof(Time), "animations");
    for (const Time time : patch.times) {
      float t[3] = {node.translation.x, node.translation.y, node.translation.z};
      float r[4] = {node.rotation.x, node.rotation.y, node.rotation.z, node.rotation.w};
      float s[3] = {node.scale.x, node.scale.y, node.scale.z};
      if (track.translation) track.translation->evaluate(time, t);
      if (track.rotation) track.rotation->evaluate(time, r);
      if (track.scale) track.scale->evaluate(time, s);
      const quat rotation(r[3], r[0], r[1], r[2]);
      const float length = glm::length(rotation);
      if (!(length > 1e-6f)) refuse(node.value.where(), "is animated by a rotation of length 0");
      const vec3 scale = visible_scale(node, s);
      patch.matrices.push_back(compose_trs({t[0], t[1], t[2]}, rotation / length, scale));
      if (!invertible(patch.matrices.back()))
        refuse(node.value.where(), "is animated by a scale without an inverse");
    }
    if (patch.times.size() == 1) patch.times.clear();  // one key is a constant pose
    return patch;
  }

  /// A scale of 0 has no inverse; a ten-thousandth cannot be seen either.
  vec3 visible_scale(const Node& node, const float* s) {
    constexpr float kSmallest = 1e-4f;
    vec3 scale(s[0], s[1], s[2]);
    const float largest = std::max({std::abs(s[0]), std::abs(s[1]), std::abs(s[2]), 1.0f});
    for (int i = 0; i < 3; ++i) {
      if (std::abs(scale[i]) >= kSmallest * largest) continue;
      scale[i] = std::copysign(kSmallest * largest, scale[i]);
      builder_.warn(
          fmt::format("node '{}': a scale of 0 in an animation became {}", node.name, kSmallest));
    }
    return scale;
  }

  MorphWeights weights(const Curve& curve) {
    const std::optional<Curve> held = curve;
    MorphWeights result{.times = key_times({&held}), .weights = {}};
    const std::size_t count = result.times.size();
    builder_.budget.take(count, sizeof(float) * curve.width, "animations");
    result.weights.resize(count * curve.width);
    for (std::size_t k = 0; k < count; ++k) {
      curve.evaluate(result.times[k], result.weights.data() + k * curve.width);
    }
    if (count == 1) result.times.clear();
    return result;
  }

  const Document& document_;
  Builder& builder_;
  const std::vector<Node>& nodes_;
  const Entities& entities_;
  const std::vector<Mesh>& meshes_;
  const std::vector<bool> lit_;
  u64 keys_ = 0;
};

}  // namespace

std::vector<Asset::Animation> load_animations(const Document& document, Builder& builder,
                                              const std::vector<Node>& nodes,
                                              const Entities& entities,
                                              const std::vector<Mesh>& meshes) {
  std::vector<Asset::Animation> animations;
  Loader loader(document, builder, nodes, entities, meshes);
  for (u32 i = 0; i < document.count("animations"); ++i) {
    animations.push_back(loader.load(document.item("animations", i), i));
  }
  return animations;
}

}  // namespace heliograph::assets::gltf
