// Collects the edits of an asset and the warnings about it. Filled by every model loader.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "renderer/assets/budget.h"
#include "renderer/assets/bundle.h"

namespace heliograph::assets {

/// Owns: the result under construction. All of the library is made before the first entity, because
/// entities refer to it by its length.
class Builder {
 public:
  Builder(Bundle files, const LoadOptions& load_options)
      : bundle(files), options(load_options), budget(load_options.limits) {}

  const Bundle bundle;
  const LoadOptions& options;
  std::string format;  // of the model, as files end; once it is known
  Budget budget;

  /// A name nobody has yet, of the library and the entities together: "Cube", "Cube_2".
  [[nodiscard]] std::string claim_name(std::string_view wanted, std::string_view fallback);

  /// `name` was claimed.
  Ref library(const std::string& name, Action action);
  /// The first is the root. Returns its index among the entities.
  u32 entity(const std::string& name, PutEntity put);
  /// Adds the root, which is the user's, and below it "z_up", which turns a file's axes and unit to
  /// ours. Returns the latter.
  u32 turned_root(const mat4x3& world_from_file);
  [[nodiscard]] Ref entity_ref(u32 index) const;
  [[nodiscard]] PutEntity& entity_at(u32 index);

  /// Says it once, however often it is found.
  void warn(const std::string& warning);
  /// A companion that the bundle lacks: it is asked for, or left out if nobody has it.
  void missing(const std::string& path);
  [[nodiscard]] bool complete() const { return missing_.empty(); }

  Loaded loaded;

 private:
  std::set<std::string, std::less<>> names_;
  std::set<std::string> warned_;
  std::set<std::string> missing_;
};

/// a * b as affine maps.
[[nodiscard]] inline mat4x3 affine_product(const mat4x3& a, const mat4x3& b) {
  const mat3 linear(a);
  return {linear * b[0], linear * b[1], linear * b[2], linear * b[3] + a[3]};
}

/// A matrix as a constant pose.
[[nodiscard]] inline PosePatch constant_pose(const mat4x3& matrix) {
  return PosePatch{.times = {}, .matrices = {matrix}};
}

/// Sets the box of all meshes at rest, relative to the root; lights do not count.
void measure(Loaded& loaded);

void load_assimp(Builder& builder);
void load_dae(Builder& builder);
void load_gltf(Builder& builder);
void load_obj(Builder& builder);
void load_ply(Builder& builder);
void load_stl(Builder& builder);
void load_volume(Builder& builder);
void load_picture(Builder& builder);

}  // namespace heliograph::assets
