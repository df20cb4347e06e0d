// Moving parts of a COLLADA file: its nodes as entities, as glTF's are, below "z_up".
#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <tuple>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/dae/transforms.h"
#include "renderer/assets/poses.h"

namespace heliograph::assets::dae {
namespace {

/// Nodes of the scene by what names them.
class Joints {
 public:
  explicit Joints(const std::vector<Placed>& nodes) : nodes_(nodes) {
    for (u32 i = 0; i < nodes.size(); ++i)
      for (const char* key : kKeys)
        if (const pugi::xml_attribute own = nodes[i].node.attribute(key))
          known_.emplace(key, own.value(), i);
  }

  /// By sid, id or name; below the skeletons of the instance if there is one.
  [[nodiscard]] std::optional<u32> find(const std::string& name, const Node& instance) const {
    for (const Node& skeleton : instance.children("skeleton")) {
      std::string_view url = skeleton.text().get();
      url.remove_prefix(url.starts_with('#'));
      const auto root = within("id", url, 0, u32(nodes_.size()));
      if (!root) continue;
      if (const auto found = below(name, *root, nodes_[*root].end)) return found;
    }
    return below(name, 0, u32(nodes_.size()));
  }

 private:
  static constexpr std::array<const char*, 3> kKeys = {"sid", "id", "name"};

  [[nodiscard]] std::optional<u32> below(std::string_view name, u32 begin, u32 end) const {
    for (const char* key : kKeys)
      if (const auto found = within(key, name, begin, end)) return found;
    return std::nullopt;
  }
  [[nodiscard]] std::optional<u32> within(const char* key, std::string_view name, u32 begin,
                                          u32 end) const {
    const auto first = known_.lower_bound({key, name, begin});
    if (first == known_.end() || *first >= std::tuple(key, name, end)) return std::nullopt;
    return std::get<u32>(*first);
  }

  const std::vector<Placed>& nodes_;
  std::set<std::tuple<std::string_view, std::string_view, u32>> known_;  // key, name, node
};

/// Keys of one node: its transformations, some of them with the numbers of channels.
class Track {
 public:
  Track(Builder& builder, Keys& keys, const Node& node) : builder_(builder), keys_(keys) {
    name_ = clean_name(name_of(node), "?");
    where_ = place(node);
    for (const Node& child : node.children())
      if (const u32 width = transform_width(child))
        steps_.push_back({child, read_floats(child, width, builder.budget)});
  }

  PosePatch poses(const std::vector<const Channel*>& channels, const Clip& clip) {
    PosePatch out{.times = times(channels, clip), .matrices = {}};
    keys_.add(out.times.size());
    builder_.budget.take(out.times.size(), sizeof(mat4x3) + sizeof(Time), "animations");
    for (const Time time : out.times) out.matrices.push_back(pose_at(channels, time));
    if (out.times.size() == 1) out.times.clear();  // one key is a constant pose
    return out;
  }

  /// The times of all curves within the clip, and its ends.
  static std::vector<Time> times(const std::vector<const Channel*>& channels, const Clip& clip) {
    std::set<double> all;
    for (const Channel* channel : channels) channel->curve.add_times(all);
    const double first = std::clamp(*all.begin(), clip.start, clip.end);
    const double last = std::clamp(*all.rbegin(), clip.start, clip.end);
    std::vector<Time> out{first};
    for (auto at = all.upper_bound(first); at != all.end() && *at < last; ++at) out.push_back(*at);
    if (last > first) out.push_back(last);
    return out;
  }

 private:
  struct Step {
    Node element;
    std::vector<float> numbers;
  };

  mat4x3 pose_at(const std::vector<const Channel*>& channels, double time) {
    mat4x3 pose(1);
    for (const Step& step : steps_) {
      std::vector<float> numbers = step.numbers;
      for (const Channel* channel : channels)
        if (channel->target == step.element)
          channel->curve.evaluate(time, numbers.data() + channel->first);
      pose = affine_product(pose, transform_with(step.element, visible(step.element, numbers)));
    }
    check_finite(pose, steps_.front().element);
    const auto thick = with_thickness(pose);
    if (!thick) refuse(where_, "is animated by a scale without an inverse");
    return *thick;
  }

  std::vector<float> visible(const Node& element, std::vector<float> numbers) {
    if (std::string_view(element.name()) != "scale") return numbers;
    const vec3 scale = keys_.visible_scale(name_, numbers.data());
    return {scale.x, scale.y, scale.z};
  }

  Builder& builder_;
  Keys& keys_;
  std::string name_, where_;
  std::vector<Step> steps_;
};

class Maker {
 public:
  Maker(Builder& builder, const Scene& scene)
      : builder_(builder), scene_(scene), joints_(scene.nodes), keys_(builder) {
    // Before the library takes names, so that entities have those of the file's nodes.
    for (const Placed& placed : scene.nodes)
      names_.push_back(builder.claim_name(name_of(placed.node), "node"));
  }

  void make(std::vector<std::optional<Look>> looks, const mat4x3& world) {
    z_up_ = builder_.turned_root(world);
    share_nodes(looks);
    for (u32 i = 0; i < scene_.nodes.size(); ++i) add_node(i, looks);
    for (std::size_t i = 0; i < looks.size(); ++i)
      if (looks[i]) add_shown(scene_.shown[i], std::move(*looks[i]));
  }

  Asset::Animation animation(const Clip& clip) {
    Asset::Animation out{.name = clip.name, .channels = {}};
    std::map<Node, std::vector<const Channel*>> moved;  // nodes and morphs
    for (const Channel& channel : clip.channels)
      moved[is_morph(channel.target) ? channel.target : channel.target.parent()].push_back(
          &channel);
    for (u32 i = 0; i < scene_.nodes.size(); ++i) {
      const Node& node = scene_.nodes[i].node;
      if (const auto found = moved.find(node); found != moved.end())
        out.channels.push_back(
            {entities_[i], Track(builder_, keys_, node).poses(found->second, clip)});
    }
    for (const auto& [morph, entity] : morphs_)
      if (const auto found = moved.find(morph); found != moved.end())
        out.channels.push_back({entity, weights(entity, found->second, clip)});
    return out;
  }

 private:
  static bool is_morph(const Node& node) { return std::string_view(node.name()) == "morph"; }

  /// A node that shows one rigid thing is that thing.
  void share_nodes(const std::vector<std::optional<Look>>& looks) {
    shown_by_.resize(scene_.nodes.size());
    std::vector<u32> counts(scene_.nodes.size());
    for (u32 i = 0; i < looks.size(); ++i) {
      const Shown& shown = scene_.shown[i];
      if (!looks[i] || ++counts[shown.node] > 1) shown_by_[shown.node].reset();
      const bool is_own = looks[i] && counts[shown.node] == 1 && !shown.skin && !shown.stands &&
                          looks[i]->geometry.centre == glm::dvec3(0);
      if (is_own) shown_by_[shown.node] = i;
    }
  }

  void add_node(u32 index, std::vector<std::optional<Look>>& looks) {
    const Placed& placed = scene_.nodes[index];
    check_finite(placed.pose, placed.node);
    const auto& own = shown_by_[index];
    PutEntity put = own ? std::move(looks[*own]->put) : PutEntity{};
    put.parent = builder_.entity_ref(placed.parent ? entities_[*placed.parent] : z_up_);
    const mat4x3 pose = set_pose(put, placed.pose, place(placed.node), builder_);
    poses_.push_back(placed.parent ? affine_product(poses_[*placed.parent], pose) : pose);
    if (own) bend(scene_.shown[*own], looks[*own]->geometry, put);
    entities_.push_back(builder_.entity(names_[index], std::move(put)));
    if (!own) return;
    note_morph(scene_.shown[*own], entities_.back());
    looks[*own].reset();
  }

  /// After all joints.
  void add_shown(const Shown& shown, Look look) {
    PutEntity& put = look.put;
    const bool is_below = !shown.skin && !shown.stands;
    put.parent = builder_.entity_ref(is_below ? entities_[shown.node] : z_up_);
    mat4x3 pose = shown.stands ? with_thickness(shown.pose).value_or(mat4x3(1)) : mat4x3(1);
    pose = about(look.geometry.centre, pose);
    if (shown.skin) {
      put.skin = skin_of(shown, look.geometry);
      pose = bound(*put.skin);
    }
    if (pose != mat4x3(1)) put.pose = constant_pose(pose);
    bend(shown, look.geometry, put);
    const std::string name = shown.skin ? shown.name + ".skin" : shown.name;
    note_morph(shown, builder_.entity(builder_.claim_name(name, "node"), std::move(put)));
  }

  static void bend(const Shown& shown, const Geometry& geometry, PutEntity& put) {
    if (shown.morph)
      put.morph_weights =
          MorphWeights{.times = {}, .weights = geometry.deformation->target_weights};
  }
  void note_morph(const Shown& shown, u32 entity) {
    if (shown.morph) morphs_.emplace_back(shown.morph, entity);
  }

  SkinPatch skin_of(const Shown& shown, const Geometry& geometry) {
    const Deformation& deformation = *geometry.deformation;
    SkinPatch skin{.joints = {}, .inverse_binds = {}};
    for (std::size_t i = 0; i < deformation.joints.size(); ++i) {
      const std::string& name = deformation.joints[i];
      const auto node = joints_.find(name, shown.instance);
      if (!node)
        builder_.warn(fmt::format("joint '{}' has no node and stays where it is bound",
                                  clean_name(name, "?")));
      skin.joints.push_back(builder_.entity_ref(node ? entities_[*node] : z_up_));
      skin.inverse_binds.push_back(
          about(geometry.centre, node ? deformation.inverse_binds[i] : deformation.bind));
      if (i == 0) first_joint_ = node ? poses_[*node] : mat4x3(1);
    }
    return skin;
  }

  /// Where the bind pose puts the mesh, so that its box at rest lies around it.
  [[nodiscard]] mat4x3 bound(const std::optional<SkinPatch>& skin) const {
    const mat4x3 pose = affine_product(first_joint_, skin->inverse_binds.front());
    return invertible(pose) ? pose : mat4x3(1);
  }

  /// All weights of an entity; those that no channel moves are as they were.
  MorphWeights weights(u32 entity, const std::vector<const Channel*>& channels, const Clip& clip) {
    std::vector<float> now = (*builder_.entity_at(entity).morph_weights)->weights;
    Curve all{.width = u32(now.size()), .times = {}, .values = {}};
    const std::vector<Time> times = Track::times(channels, clip);
    builder_.budget.take(times.size(), (now.size() + 1) * sizeof(float), "animations");
    for (const Time time : times) {
      if (!all.times.empty() && float(time) <= all.times.back()) continue;
      for (const Channel* channel : channels)
        channel->curve.evaluate(time, now.data() + channel->first);
      all.times.push_back(float(time));
      all.values.insert(all.values.end(), now.begin(), now.end());
    }
    return keys_.weights(all);
  }

  Builder& builder_;
  const Scene& scene_;
  const Joints joints_;
  Keys keys_;
  std::vector<std::string> names_;            // by node
  std::vector<u32> entities_;                 // by node
  std::vector<mat4x3> poses_;                 // of nodes in z_up
  std::vector<std::optional<u32>> shown_by_;  // what a node itself shows
  std::vector<std::pair<Node, u32>> morphs_;  // entities that show them
  mat4x3 first_joint_{1};
  u32 z_up_ = 0;
};

}  // namespace

void put_moving(const Document& document, Builder& builder, const Scene& scene,
                const std::vector<Clip>& clips, const mat4x3& world) {
  Maker maker(builder, scene);
  std::vector<std::optional<Look>> looks = load_looks(document, builder, scene.shown);
  if (!builder.complete()) return;
  maker.make(std::move(looks), world);
  for (const Clip& clip : clips) builder.loaded.asset.animations.push_back(maker.animation(clip));
}

}  // namespace heliograph::assets::dae
