// Skins and morph targets. Source: COLLADA 1.5.0, chapter 4 (skinning), chapter 5 (skin, morph).
#include <algorithm>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/dae/transforms.h"
#include "renderer/assets/influences.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr u64 kMostJoints = 0x10000;

class Reader {
 public:
  Reader(const Document& document, Builder& builder) : document_(document), builder_(builder) {}

  Deformation read(const Shown& shown) {
    if (shown.skin) read_skin(shown.skin);
    if (shown.morph) read_morph(shown.morph, shown.geometry);
    return std::move(out_);
  }

 private:
  // ---------------------------------------------------------------- skins

  void read_skin(const Node& skin) {
    const Node joints = skin.child("joints");
    out_.joints = names_of(needed_input(joints, "JOINT"));
    if (out_.joints.empty()) refuse(place(skin), "names no joints");
    Budget::check(out_.joints.size(), kMostJoints, "joints", place(skin));
    if (const Node bind = skin.child("bind_shape_matrix"))
      out_.bind = matrix_of(read_floats(bind, 16, builder_.budget), bind);
    const std::vector<float> binds =
        read_rows(document_, needed_input(joints, "INV_BIND_MATRIX"), 16, builder_.budget);
    if (binds.size() != 16 * out_.joints.size())
      refuse(place(skin), fmt::format("has {} joints, but {} numbers of INV_BIND_MATRIX",
                                      out_.joints.size(), binds.size()));
    for (std::size_t i = 0; i < binds.size(); i += 16)
      out_.inverse_binds.push_back(
          affine_product(matrix_of(std::span(binds).subspan(i, 16), joints), out_.bind));
    read_weights(skin.child("vertex_weights"), joints);
  }

  void read_weights(const Node& element, const Node& joints) {
    const std::string where = place(element);
    const Node joint = needed_input(element, "JOINT"), weight = needed_input(element, "WEIGHT");
    const std::vector<float> weights = read_rows(document_, weight, 1, builder_.budget);
    const std::vector<u32> own = joints_of(joint, needed_input(joints, "JOINT"));
    const u32 joint_at = offset_of(joint), weight_at = offset_of(weight);
    u64 stride = 1;
    for (const Node& input : element.children("input"))
      stride = std::max<u64>(stride, offset_of(input) + 1);
    const std::vector<u32> counts = read_indices(element.child("vcount"), builder_.budget);
    // -1: the geometry as it is bound.
    const std::vector<u32> indices = read_indices(element.child("v"), builder_.budget, true);
    builder_.budget.take(counts.size(), sizeof(vec4) + sizeof(glm::u16vec4), where);
    std::vector<Influence> influences;
    u64 at = 0;
    for (const u32 count : counts) {
      if (count * stride > indices.size() - at) refuse(where, "<vcount> counts more than <v> has");
      influences.clear();
      for (const u64 end = at + count * stride; at < end; at += stride) {
        const u32 of = indices[at + joint_at], number = indices[at + weight_at];
        if (number >= weights.size() || (of != kNone && of >= own.size()))
          refuse(where, fmt::format("names joint {} and weight {} of {} and {}", of, number,
                                    own.size(), weights.size()));
        if (of != kNone) influences.push_back({own[of], weights[number]});
      }
      add(influences);
    }
  }

  void add(std::vector<Influence>& influences) {
    std::erase_if(influences, [](const Influence& influence) { return !(influence.weight > 0); });
    if (influences.empty()) builder_.warn("vertices that no joint moves follow the first");
    if (influences.size() > 4)
      builder_.warn("vertices follow more than 4 joints; the 4 strongest are kept");
    keep_strongest(influences, out_.skin);
  }

  /// Weights may number joints in an order of their own.
  std::vector<u32> joints_of(const Node& input, const Node& joints) {
    std::vector<u32> out(out_.joints.size());
    for (u32 i = 0; i < out.size(); ++i) out[i] = i;
    const auto source_of = [](const Node& node) {
      return std::string_view(node.attribute("source").value());
    };
    if (source_of(input) == source_of(joints)) return out;
    std::map<std::string_view, u32> known;
    for (u32 i = 0; i < out_.joints.size(); ++i) known.try_emplace(out_.joints[i], i);
    out.clear();
    for (const std::string& name : names_of(input)) {
      const auto found = known.find(name);
      if (found == known.end())
        refuse(place(input), fmt::format("weighs '{}', which is no joint", clean_name(name, "?")));
      out.push_back(found->second);
    }
    return out;
  }

  // ---------------------------------------------------------------- morph targets

  void read_morph(const Node& morph, const Node& geometry) {
    const std::string where = place(morph);
    const Node targets = morph.child("targets");
    const bool relative = std::string_view(morph.attribute("method").value()) == "RELATIVE";
    const std::vector<float> base = positions_of(geometry);
    for (const std::string& name : names_of(needed_input(targets, "MORPH_TARGET"))) {
      const std::vector<float> target =
          positions_of(document_.linked("#" + name, "geometry", where));
      if (target.size() != base.size())
        refuse(where, fmt::format("target '{}' has {} vertices, its geometry {}",
                                  clean_name(name, "?"), target.size() / 3, base.size() / 3));
      std::vector<vec3>& out = out_.targets.emplace_back();
      for (std::size_t i = 0; i < base.size(); i += 3) {
        const vec3 from(base[i], base[i + 1], base[i + 2]);
        out.push_back(vec3(target[i], target[i + 1], target[i + 2]) - (relative ? vec3(0) : from));
      }
    }
    out_.target_weights =
        read_rows(document_, needed_input(targets, "MORPH_WEIGHT"), 1, builder_.budget);
    if (out_.target_weights.size() != out_.targets.size())
      refuse(where, fmt::format("has {} targets, but {} weights", out_.targets.size(),
                                out_.target_weights.size()));
  }

  std::vector<float> positions_of(const Node& geometry) {
    const Node vertices = geometry.child("mesh").child("vertices");
    return read_rows(document_, needed_input(vertices, "POSITION"), 3, builder_.budget);
  }

  // ---------------------------------------------------------------- elements

  std::vector<std::string> names_of(const Node& input) const {
    return read_names(document_, input, builder_.budget);
  }

  const Document& document_;
  Builder& builder_;
  Deformation out_;
};

}  // namespace

Node input_of(const Node& element, const char* semantic) {
  return element.find_child_by_attribute("input", "semantic", semantic);
}

Node needed_input(const Node& element, const char* semantic) {
  const Node found = input_of(element, semantic);
  if (!found)
    refuse(place(element), fmt::format("<{}> has no <input> of {}", element.name(), semantic));
  return found;
}

std::vector<std::string> read_names(const Document& document, const Node& input, Budget& budget) {
  const Node source = document.linked(input.attribute("source").value(), "source", place(input));
  std::string_view text;
  for (const char* tag : {"Name_array", "IDREF_array", "SIDREF_array"})
    if (const Node array = source.child(tag)) text = array.text().get();
  std::vector<std::string> names;
  for (std::string_view word = take_word(text); !word.empty(); word = take_word(text)) {
    budget.take(1, sizeof(std::string) + word.size(), place(source));
    names.emplace_back(word);
  }
  return names;
}

std::vector<float> read_rows(const Document& document, const Node& input, u32 width,
                             Budget& budget) {
  const std::string where = place(input);
  const Node source = document.linked(input.attribute("source").value(), "source", where);
  const Node accessor = source.child("technique_common").child("accessor");
  Node array = source.child("float_array");
  if (accessor) array = document.linked(accessor.attribute("source").value(), "float_array", where);
  std::vector<float> numbers = read_floats(array, budget);
  const u64 stride = accessor ? whole_attribute(accessor, "stride", 1) : width;
  const u64 offset = whole_attribute(accessor, "offset", 0);
  const u64 count = whole_attribute(accessor, "count", u32(numbers.size() / width));
  const u64 end = count == 0 ? 0 : offset + (count - 1) * stride + width;
  if (stride < width || end > numbers.size())
    refuse(place(source),
           fmt::format("has {} numbers, not {} rows of {}", numbers.size(), count, width));
  if (stride == width && offset == 0) {
    numbers.resize(count * width);
    return numbers;
  }
  budget.take(count * width, sizeof(float), where);
  std::vector<float> out;
  for (u64 row = 0; row < count; ++row)
    for (u64 column = 0; column < width; ++column)
      out.push_back(numbers[offset + row * stride + column]);
  return out;
}

Deformation read_deformation(const Document& document, Builder& builder, const Shown& shown) {
  return Reader(document, builder).read(shown);
}

}  // namespace heliograph::assets::dae
