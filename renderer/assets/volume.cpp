// Volumes: .nvdb and .vdb to a Volume, or to the surface of their level sets, and the entity that
// shows it. Chosen by load.cpp.
#include <tbb/task_arena.h>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"
#include "renderer/assets/model.h"
#include "renderer/assets/volume_file.h"
#include "renderer/assets/volume_surface.h"

namespace heliograph::assets {
namespace {

constexpr std::size_t kNone = ~std::size_t(0);

/// The first grid of a file that has so many channels and one of these names.
std::size_t named(const VolumeFile& file, u32 channels,
                  std::initializer_list<std::string_view> names) {
  for (const std::string_view name : names)
    for (std::size_t i = 0; i < file.entries().size(); ++i)
      if (file.entries()[i].channels == channels && file.entries()[i].name == name) return i;
  return kNone;
}

std::size_t density_of(const VolumeFile& file, std::size_t temperature) {
  const std::size_t grid = named(file, 1, {"density", "Density"});
  if (grid != kNone) return grid;
  for (std::size_t i = 0; i < file.entries().size(); ++i)
    if (file.entries()[i].channels == 1 && i != temperature) return i;
  std::string names;
  for (const FileEntry& entry : file.entries())
    names += fmt::format(" '{}'{}", entry.name, entry.why.empty() ? "" : " (" + entry.why + ")");
  refuse("grids", "no grid of numbers could be the density; there are:" + names);
}

/// Warns of what it does not show of a grid.
void warn_of(Builder& builder, const std::string& name, const FileGrid& read, float most) {
  if (read.look.level_set)
    builder.warn(fmt::format(
        "grid '{}' is a level set: shown as fog; surface=True makes a mesh of it", name));
  else if (read.look.background != 0)
    builder.warn(
        fmt::format("grid '{}': its background is not 0, but nothing is outside of it", name));
  if (read.clamped)
    builder.warn(fmt::format("grid '{}': values outside [0, {}] are clamped", name, most));
}

std::shared_ptr<const Grid> take(Builder& builder, VolumeFile& file, std::size_t entry,
                                 float most) {
  if (entry == kNone) return nullptr;
  FileGrid read;
  file.read(entry,
            [&](Bricks& bricks, const Bricks::Read& values) { read = bricks.make(values, most); });
  warn_of(builder, file.entries()[entry].name, read, most);
  return std::make_shared<const Grid>(std::move(read.grid));
}

PutVolume to_volume(Builder& builder, VolumeFile& file) {
  constexpr float kMost = 1e9f;
  const std::size_t temperature = named(file, 1, {"temperature", "Temperature"});
  const std::size_t color = named(file, 3, {"color", "Cd", "albedo"});
  const std::size_t density = density_of(file, temperature);
  for (std::size_t i = 0; i < file.entries().size(); ++i) {
    const auto& [name, channels, why] = file.entries()[i];
    if (channels == 0)
      builder.warn(fmt::format("not read: grid '{}' ({})", name, why));
    else if (i != density && i != temperature && i != color)
      builder.warn(fmt::format("grid '{}' is not used", name));
  }
  PutVolume put{.density = take(builder, file, density, kMost)};
  if (auto grid = take(builder, file, temperature, kMost)) put.temperature = grid;
  if (auto grid = take(builder, file, color, 1)) put.color = grid;
  return put;
}

/// Every level set as a part of one mesh.
Model to_surface(Builder& builder, VolumeFile& file) {
  Model model{.mesh = {}, .positions = {}, .materials = {}, .where = "grids"};
  std::string others;
  for (std::size_t i = 0; i < file.entries().size(); ++i) {
    const auto& [name, channels, why] = file.entries()[i];
    bool is_shown = false;
    if (channels == 1)
      file.read(i, [&](Bricks& bricks, const Bricks::Read& values) {
        is_shown = bricks.look().level_set;
        if (is_shown) add_surface(bricks, values, name, model, builder.budget);
      });
    if (!is_shown) others += fmt::format(" '{}'", name);
  }
  if (model.mesh.triangles.empty())
    refuse_option("surface", "no grid is a level set, leave it out; there are:" + others);
  if (!others.empty()) builder.warn("no level sets, and left out:" + others);
  return model;
}

/// Opens the file for `read(VolumeFile&)`. The library's own threads are as many as there may be in
/// the sandbox: none. Its trees are freed by them, too.
template <class Read>
auto read_file(Builder& builder, const Read& read) {
  return tbb::task_arena(1).execute([&] {
    const auto open = builder.format == "nvdb" ? open_nvdb : open_vdb;
    return read(*open(builder.bundle.model().bytes, builder.budget));
  });
}

}  // namespace

void load_volume(Builder& builder) {
  if (builder.options.surface)
    return put_model(
        builder, read_file(builder, [&](VolumeFile& file) { return to_surface(builder, file); }));
  const std::string stem = stem_of(builder.bundle.model().path);
  const Ref ref = builder.library(
      builder.claim_name(stem, "volume"),
      read_file(builder, [&](VolumeFile& file) { return to_volume(builder, file); }));
  const float metres = builder.options.units > 0 ? float(builder.options.units) : 1.0f;
  const mat3 turned = z_up_from(builder.options.up) * metres;
  PutEntity shown;
  shown.volume = ref;
  std::string name;
  if (turned != mat3(1)) {
    // Voxels cannot be rewritten, so axes and units go into an entity below the root.
    shown.parent = builder.entity_ref(builder.entity("", PutEntity{}));
    shown.pose = constant_pose(mat4x3(turned));
    name = builder.claim_name("volume", "volume");
  }
  builder.entity(name, std::move(shown));
}

}  // namespace heliograph::assets
