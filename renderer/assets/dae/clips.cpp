// <animation>s as clips: what their channels move, and when. Source: COLLADA 1.5.0, chapter 3
// (address syntax), chapter 5 (animation, channel, animation_clip).
#include <algorithm>
#include <limits>
#include <set>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/dae/transforms.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr double kForever = std::numeric_limits<double>::infinity();
constexpr std::size_t kLongestTarget = 200;

/// A name and what of it is meant: "trans.X", "weights(2)", "matrix(3)(0)".
struct Step {
  std::string_view name, member;
};
Step split(std::string_view text, std::string_view marks) {
  const std::size_t at = std::min(text.find_first_of(marks), text.size());
  return {text.substr(0, at), text.substr(at)};
}

/// Index of a member among an element's numbers; nullopt: it has none of that name.
std::optional<u32> index_of_member(std::string_view tag, std::string_view member) {
  static const std::map<std::string_view, u32> kNames = {
      {".X", 0}, {".Y", 1}, {".Z", 2}, {".ANGLE", 3}};
  if (const auto found = kNames.find(member); found != kNames.end())
    return tag == "matrix" ? std::nullopt : std::optional(found->second);
  u32 index = 0;
  for (u32 step = 1; !member.empty(); step *= 4) {  // of a matrix, column and row
    const std::size_t end = member.find(')');
    if (!member.starts_with('(') || end == member.npos || step > 4) return std::nullopt;
    const auto number = parse<u32>(member.substr(1, end - 1));
    if (!number || *number > 0xffff) return std::nullopt;
    index += *number * step;
    member.remove_prefix(end + 1);
  }
  return index;
}

/// Target of a channel.
struct Target {
  Node element;
  u32 first = 0, width = 0;
  std::optional<u32> angle;  // of the width, what turns
};

class Loader {
 public:
  Loader(const Document& document, Builder& builder, const Scene& scene)
      : document_(document), builder_(builder) {
    for (const Shown& shown : scene.shown) {
      is_deformed_ |= shown.skin || shown.morph;
      if (shown.morph) morphs_[shown.morph] = 0;
      for (std::optional<u32> at = shown.node; at; at = scene.nodes[*at].parent)
        if (!nodes_.insert(scene.nodes[*at].node).second) break;
    }
    if (std::ranges::any_of(scene.shown, [](const Shown& shown) { return !!shown.skin; }))
      for (const Placed& placed : scene.nodes) nodes_.insert(placed.node);
    for (auto& [morph, count] : morphs_)
      count =
          u32(read_names(document, input_of(morph.child("targets"), "MORPH_TARGET"), builder.budget)
                  .size());
  }

  std::vector<Clip> load() {
    const Node library = document_.root().child("library_animations");
    for (const Node& set : document_.root().children("library_animation_clips"))
      for (const Node& clip : set.children("animation_clip")) add_clip(clip);
    if (clips_.empty() && !had_clips_) add_all();
    if (clips_.empty() && !is_deformed_) {
      if (library.child("animation")) builder_.warn("COLLADA animations are left out");
    } else {
      for (const std::string& warning : left_out_) builder_.warn(warning);
    }
    return std::move(clips_);
  }

 private:
  // ---------------------------------------------------------------- clips

  /// All that there is, which the file plays at once.
  void add_all() {
    Clip clip{.name = "animation_0", .start = -kForever, .end = kForever, .channels = {}};
    std::vector<Node> tops;
    for (const Node& library : document_.root().children("library_animations"))
      for (const Node& animation : library.children("animation")) tops.push_back(animation);
    if (tops.size() == 1) clip.name = clean_name(name_of(tops[0]), clip.name);
    for (const Node& animation : tops) add_animation(animation, clip);
    keep(std::move(clip));
  }

  void add_clip(const Node& element) {
    had_clips_ = true;
    Clip clip{.name = clean_name(name_of(element), fmt::format("animation_{}", clips_.size())),
              .start = time_of(element, "start", -kForever),
              .end = time_of(element, "end", kForever),
              .channels = {}};
    if (clip.end < clip.start)
      refuse(place(element), "an <animation_clip> must not end before it starts");
    for (const Node& instance : element.children("instance_animation"))
      add_animation(
          document_.linked(instance.attribute("url").value(), "animation", place(element)), clip);
    keep(std::move(clip));
  }

  void keep(Clip clip) {
    if (!clip.channels.empty()) clips_.push_back(std::move(clip));
  }

  static double time_of(const Node& element, const char* key, double absent) {
    const std::string_view text = trimmed(element.attribute(key).value());
    if (text.empty()) return absent;
    const std::optional<double> time = parse_double(text);
    if (!time)
      refuse(place(element), fmt::format("{}=\"{}\" is no time", key, clean_name(text, "")));
    return *time;
  }

  void add_animation(const Node& animation, Clip& clip) {
    for (const Node& child : animation.children()) {
      const std::string_view tag = child.name();
      if (tag == "animation") add_animation(child, clip);
      if (tag == "channel") add_channel(child, clip);
    }
  }

  void add_channel(const Node& channel, Clip& clip) {
    const std::string_view text = channel.attribute("target").value();
    const std::optional<Target> target = resolve(text);
    if (!target) {
      left_out_.insert(
          fmt::format("the animation of '{}' is left out: it is no transformation or "
                      "morph weight of what the scene shows",
                      clean_text(text, kLongestTarget)));
      return;
    }
    const Node sampler =
        document_.linked(channel.attribute("source").value(), "sampler", place(channel));
    auto curve = read_curve(document_, builder_, sampler, target->width, target->angle);
    if (curve) clip.channels.push_back({target->element, target->first, std::move(*curve)});
  }

  // ---------------------------------------------------------------- targets

  /// "node/transform.X", "node/bone/transform", "controller/weights(0)", "weights-source(0)".
  std::optional<Target> resolve(std::string_view text) const {
    const std::size_t slash = std::min(text.find('/'), text.size());
    const std::string_view id = text.substr(0, slash);
    if (slash == text.size()) {
      const auto [source, member] = split(text, "(");
      return weights_of(document_.find(source, "source").parent(), member);
    }
    const std::string_view path = text.substr(slash + 1);
    if (const Node node = document_.find(id, "node")) return transform_at(node, path);
    return weights_of(document_.find(id, "controller").child("morph"), split(path, "(").member);
  }

  /// sids, each below the one before it.
  std::optional<Target> transform_at(Node node, std::string_view path) const {
    for (std::size_t slash = path.find('/'); slash != path.npos; slash = path.find('/')) {
      node = below(node, path.substr(0, slash));
      path.remove_prefix(slash + 1);
    }
    if (!nodes_.contains(node)) return std::nullopt;
    Step step{path, {}};
    Node element = below(node, step.name);
    if (!element) step = split(path, ".("), element = below(node, step.name);
    const u32 width = element ? transform_width(element) : 0;
    const std::string_view tag = element.name();
    const std::optional<u32> turns = tag == "rotate" ? std::optional(3u) : std::nullopt;
    if (step.member.empty()) return found({element, 0, width, turns}, width);
    const auto member = index_of_member(tag, step.member);
    if (!member) return std::nullopt;
    return found({element, *member, 1, turns == member ? std::optional(0u) : std::nullopt}, width);
  }

  static Node below(const Node& node, std::string_view sid) {
    return node.find_child_by_attribute("sid", std::string(sid).c_str());
  }

  std::optional<Target> weights_of(const Node& morph, std::string_view member) const {
    const auto known = morphs_.find(morph);
    if (known == morphs_.end()) return std::nullopt;
    if (member.empty()) return found({morph, 0, known->second, {}}, known->second);
    const auto index = member.starts_with('(') ? index_of_member("", member) : std::nullopt;
    if (!index) return std::nullopt;
    return found({morph, *index, 1, {}}, known->second);
  }

  /// Unless it is of more numbers than there are.
  static std::optional<Target> found(const Target& target, u32 width) {
    if (target.width == 0 || target.first + target.width > width) return std::nullopt;
    return target;
  }

  const Document& document_;
  Builder& builder_;
  std::set<Node> nodes_;        // that move what is shown
  std::map<Node, u32> morphs_;  // that are shown, and how many targets they have
  std::vector<Clip> clips_;
  bool had_clips_ = false, is_deformed_ = false;
  std::set<std::string> left_out_;
};

}  // namespace

std::vector<Clip> read_clips(const Document& document, Builder& builder, const Scene& scene) {
  return Loader(document, builder, scene).load();
}

}  // namespace heliograph::assets::dae
