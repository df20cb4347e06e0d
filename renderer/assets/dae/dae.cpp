// COLLADA to an asset: the order of the steps. Chosen by load.cpp.
//
// The root entity is the user's. Below it each geometry that a node shows is an entity, whose pose
// holds the transforms of the nodes, the turn to +Z up and the scale to metres. A file with a skin,
// morph targets or animations of what it shows has an entity for each node instead (moving.cpp).
#include <algorithm>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/poses.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

using namespace dae;

/// Axes and units that <asset> states, unless the caller gives others.
mat4x3 world_from_file(const Document& document, const Builder& builder) {
  const Node asset = document.root().child("asset");
  std::string up = builder.options.up;
  if (up.empty()) {
    const std::string_view axis = trimmed(asset.child_value("up_axis"));
    if (axis != "" && axis != "X_UP" && axis != "Y_UP" && axis != "Z_UP")
      refuse("asset.up_axis", "must be X_UP, Y_UP or Z_UP");
    up = std::string(1, axis == "Z_UP" ? 'z' : axis == "X_UP" ? 'x' : 'y');
  }
  double metres = builder.options.units;
  if (!(metres > 0)) {
    std::string meter(trimmed(asset.child("unit").attribute("meter").value()));
    std::ranges::replace(meter, ',', '.');  // of programs in some languages
    metres = meter.empty() ? 1 : double(parse_number(meter).value_or(0));
    constexpr double kSmallest = 1e-9, kLargest = 1e9;
    if (!(metres >= kSmallest && metres <= kLargest))
      refuse("asset.unit.meter", "must be a number of metres in [1e-9, 1e9]; give units=");
  }
  return mat4x3(mat4(float(metres) * z_up_from(up)));
}

/// Geometries without nodes, for which things at rest have no use: each is placed by all of those
std::vector<Shown> placed(std::vector<Shown> all, Builder& builder) {
  std::erase_if(all, [&](Shown& shown) {
    const std::string where = place(shown.instance.parent());
    const auto thick = with_thickness(shown.pose);
    if (!thick) {
      builder.warn(fmt::format("{} has a scale without an inverse and is left out", where));
      return true;
    }
    if (*thick != shown.pose)
      builder.warn(fmt::format("{} has a scale of 0 along one axis and is kept flat", where));
    shown.pose = *thick;
    return false;
  });
  return all;
}

void put_standing(const Document& document, Builder& builder, const std::vector<Shown>& all,
                  const mat4x3& world) {
  std::vector<std::optional<Look>> looks = load_looks(document, builder, all);
  if (!builder.complete()) return;
  const u32 root = builder.entity("", PutEntity{});
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!looks[i]) continue;
    PutEntity& put = looks[i]->put;
    const mat4x3 pose = about(looks[i]->geometry.centre, affine_product(world, all[i].pose));
    if (pose != mat4x3(1)) put.pose = constant_pose(pose);
    put.parent = builder.entity_ref(root);
    builder.entity(builder.claim_name(all[i].name, "node"), std::move(put));
  }
}

bool is_deformed(const Shown& shown) { return shown.skin || shown.morph; }

}  // namespace

void load_dae(Builder& builder) {
  const Document document(builder);
  const mat4x3 world = world_from_file(document, builder);
  const Scene scene = read_scene(document, builder);
  const std::vector<Clip> clips = read_clips(document, builder, scene);
  if (clips.empty() && std::ranges::none_of(scene.shown, is_deformed)) {
    put_standing(document, builder, placed(scene.shown, builder), world);
  } else {
    put_moving(document, builder, scene, clips, world);
  }
}

}  // namespace heliograph::assets
