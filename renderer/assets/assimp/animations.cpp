// Clips of assimp: keys of nodes by their names, and weights of morph targets by those of meshes.
#include <algorithm>
#include <cmath>

#include "renderer/assets/assimp/scene.h"
#include "renderer/assets/curves.h"

namespace heliograph::assets::assimp {
namespace {

/// Keys in the order of their times; of several at one time the last counts. nullopt: there are
/// none whose time is a number.
template <class Key, class Read>
std::optional<Curve> curve_of(const Key* keys, u32 count, double seconds, u32 width, Read read) {
  std::map<float, std::size_t> order;
  for (u32 k = 0; k < count; ++k) {
    const auto time = float(keys[k].mTime * seconds);
    if (std::isfinite(time)) order[time] = k;
  }
  if (order.empty()) return std::nullopt;
  Curve curve{.width = width, .times = {}, .values = {}};
  for (const auto& [time, k] : order) {
    curve.times.push_back(time);
    read(keys[k], curve.values);
  }
  return curve;
}

void read_vector(const aiVectorKey& key, std::vector<float>& out) {
  for (const double number : {key.mValue.x, key.mValue.y, key.mValue.z})
    out.push_back(float(number));
}

class Loader {
 public:
  Loader(Builder& builder, const std::map<std::string, Placed>& placed)
      : builder_(builder), placed_(placed), keys_(builder) {}

  Asset::Animation load(const aiAnimation& clip, u32 index) {
    constexpr double kUsual = 25;  // ticks a second, where a file has none
    seconds_ = 1 / (clip.mTicksPerSecond > 0 ? clip.mTicksPerSecond : kUsual);
    Asset::Animation out{
        .name = clean_name(text_of(clip.mName), fmt::format("animation_{}", index)),
        .channels = {}};
    for (u32 i = 0; i < clip.mNumChannels; ++i) add(*clip.mChannels[i], out);
    for (u32 i = 0; i < clip.mNumMorphMeshChannels; ++i) add(*clip.mMorphMeshChannels[i], out);
    return out;
  }

 private:
  const Placed* find(const std::string& name) const {
    const auto found = placed_.find(name);
    return found == placed_.end() ? nullptr : &found->second;
  }

  void add(const aiNodeAnim& channel, Asset::Animation& out) {
    const std::string name = text_of(channel.mNodeName);
    const Placed* placed = find(name);
    if (!placed) return;
    aiVector3D scale, translation;
    aiQuaternion rotation;
    placed->node->mTransformation.Decompose(scale, rotation, translation);
    const Rest rest{.name = name,
                    .where = fmt::format("node '{}'", clean_name(name, "?")),
                    .translation = vector_of(translation),
                    .rotation = quat(float(rotation.w), float(rotation.x), float(rotation.y),
                                     float(rotation.z)),
                    .scale = vector_of(scale)};
    Track track;
    track.translation =
        curve_of(channel.mPositionKeys, channel.mNumPositionKeys, seconds_, 3, read_vector);
    track.scale = curve_of(channel.mScalingKeys, channel.mNumScalingKeys, seconds_, 3, read_vector);
    track.rotation = curve_of(channel.mRotationKeys, channel.mNumRotationKeys, seconds_, 4,
                              [](const aiQuatKey& key, std::vector<float>& values) {
                                const aiQuaternion& q = key.mValue;
                                for (const double n : {q.x, q.y, q.z, q.w})
                                  values.push_back(float(n));
                              });
    if (track.rotation) track.rotation->rotation = true;
    PosePatch poses = keys_.poses(rest, track);
    if (!poses.matrices.empty()) out.channels.push_back({placed->entity, std::move(poses)});
  }

  /// Names are those of a node, and in FBX "*" and a number behind it.
  void add(const aiMeshMorphAnim& channel, Asset::Animation& out) {
    const std::string name = text_of(channel.mName);
    const Placed* placed = find(name.substr(0, name.rfind('*')));
    if (!placed || placed->morphs.empty()) {
      builder_.warn("an animation of morph targets that no node shows is left out");
      return;
    }
    for (const auto& [entity, rest] : placed->morphs) {
      std::vector<float> weights = rest;  // a key that leaves a target out leaves it as it was
      const auto count = u32(rest.size());
      const auto read = [&](const aiMeshMorphKey& key, std::vector<float>& values) {
        for (u32 i = 0; i < key.mNumValuesAndWeights; ++i)
          if (key.mValues[i] < count) weights[key.mValues[i]] = float(key.mWeights[i]);
        values.insert(values.end(), weights.begin(), weights.end());
      };
      const auto curve = curve_of(channel.mKeys, channel.mNumKeys, seconds_, count, read);
      if (curve) out.channels.push_back({entity, keys_.weights(*curve)});
    }
  }

  Builder& builder_;
  const std::map<std::string, Placed>& placed_;
  Keys keys_;
  double seconds_ = 0;  // a tick
};

}  // namespace

std::vector<Asset::Animation> load_animations(const aiScene& scene, Builder& builder,
                                              const std::map<std::string, Placed>& placed) {
  Loader loader(builder, placed);
  std::vector<Asset::Animation> clips;
  for (u32 i = 0; i < scene.mNumAnimations; ++i) {
    clips.push_back(loader.load(*scene.mAnimations[i], i));
    if (clips.back().channels.empty()) clips.pop_back();
  }
  return clips;
}

}  // namespace heliograph::assets::assimp
