// Volumes: .nvdb and .vdb to a Volume and the entity that shows it. Chosen by load.cpp.
#include <algorithm>
#include <cmath>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"
#include "renderer/assets/volume_bricks.h"

namespace heliograph::assets {
namespace {

/// The first grid of a file that has so many channels and one of these names.
FileGrid* named(VolumeFile& file, u32 channels, std::initializer_list<std::string_view> names) {
  for (const std::string_view name : names)
    for (FileGrid& grid : file.grids)
      if (grid.channels() == channels && grid.name() == name) return &grid;
  return nullptr;
}

FileGrid& density_of(VolumeFile& file, const FileGrid* temperature) {
  if (FileGrid* grid = named(file, 1, {"density", "Density"})) return *grid;
  for (FileGrid& grid : file.grids)
    if (grid.channels() == 1 && &grid != temperature) return grid;
  std::string names;
  for (const FileGrid& grid : file.grids) names += fmt::format(" {}", grid.name());
  for (const std::string& name : file.skipped) names += fmt::format(" {}", clean_text(name, 200));
  refuse("grids", "no grid of floats could be the density; there are:" + names);
}

std::shared_ptr<const Grid> take(Builder& builder, FileGrid* grid, float most) {
  if (!grid) return nullptr;
  if (grid->level_set)
    builder.warn(fmt::format("grid '{}' is a level set: shown as fog", grid->name()));
  else if (grid->background != 0)
    builder.warn(fmt::format("grid '{}': its background is not 0, but nothing is outside of it",
                             grid->name()));
  if (grid->make_fog(most))
    builder.warn(fmt::format("grid '{}': values outside [0, {}] are clamped", grid->name(), most));
  return std::make_shared<const Grid>(grid->finish());
}

PutVolume to_volume(Builder& builder, VolumeFile& file) {
  constexpr float kMost = 1e9f;
  FileGrid* temperature = named(file, 1, {"temperature", "Temperature"});
  FileGrid* color = named(file, 3, {"color", "Cd", "albedo"});
  FileGrid* density = &density_of(file, temperature);
  for (const FileGrid& grid : file.grids)
    if (&grid != density && &grid != temperature && &grid != color)
      builder.warn(fmt::format("grid '{}' is not used", grid.name()));
  for (const std::string& name : file.skipped)
    builder.warn("not read: grid " + clean_text(name, 200));
  PutVolume put{.density = take(builder, density, kMost)};
  if (auto grid = take(builder, temperature, kMost)) put.temperature = grid;
  if (auto grid = take(builder, color, 1)) put.color = grid;
  return put;
}

}  // namespace

void load_volume(Builder& builder) {
  const BundleFile& file = builder.bundle.model();
  const std::string format =
      builder.options.format.empty() ? extension_of(file.path) : builder.options.format;
  VolumeFile read = format == "nvdb" ? read_nvdb(file.bytes, builder.budget)
                                     : read_vdb(file.bytes, builder.budget);
  const std::string stem = stem_of(file.path);
  const Ref ref = builder.library(builder.claim_name(stem, "volume"), to_volume(builder, read));
  PutEntity root;
  const float metres = builder.options.units > 0 ? float(builder.options.units) : 1.0f;
  const mat3 turned = z_up_from(builder.options.up) * metres;
  if (turned == mat3(1)) {
    root.volume = ref;
    builder.entity("", std::move(root));
    return;
  }
  // Voxels cannot be rewritten, so axes and units go into an entity below the root.
  PutEntity below;
  below.parent = builder.entity_ref(builder.entity("", std::move(root)));
  below.volume = ref;
  below.pose = constant_pose(mat4x3(turned[0], turned[1], turned[2], vec3(0)));
  builder.entity(builder.claim_name("volume", "volume"), std::move(below));
}

}  // namespace heliograph::assets
