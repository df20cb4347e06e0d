// Handles of scene objects, and reading them back. Made by edits and by a scene's look-ups.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/array.h"
#include "heliograph/camera.h"
#include "heliograph/light.h"
#include "heliograph/material.h"
#include "heliograph/pose.h"
#include "heliograph/ref.h"

namespace heliograph::client {

class Mesh;
class Material;

/// Entity of a scene. Methods that read ask the daemon each time.
class Entity : public Handle {
 public:
  static constexpr Kind kKind = Kind::kEntity;
  using Handle::Handle;

  [[nodiscard]] Mat4 transform() const;        // parent_from_local at the scene's time
  [[nodiscard]] Mat4 world_transform() const;  // world_from_local
  /// Lower and upper corner in the world, metres, around it and all beneath it; none without a
  /// mesh.
  [[nodiscard]] std::optional<std::array<Vec3, 2>> aabb() const;
  [[nodiscard]] std::optional<Entity> parent() const;
  [[nodiscard]] std::optional<Mesh> mesh() const;
  /// The material of each part; the last one serves all further parts. An empty handle is the
  /// default material.
  [[nodiscard]] std::vector<Material> materials() const;
  [[nodiscard]] bool visible() const;
  [[nodiscard]] Camera camera() const;  // kNotFound without one
  [[nodiscard]] std::optional<Light> light() const;
  [[nodiscard]] std::optional<Portal> portal() const;
  [[nodiscard]] std::string light_group() const;
  [[nodiscard]] std::map<std::string, std::string> attributes() const;
};

/// A triangle mesh, read at the scene's time.
class Mesh : public Handle {
 public:
  static constexpr Kind kKind = Kind::kMesh;
  using Handle::Handle;

  [[nodiscard]] Array positions() const;  // (V, 3) f32 metres
  [[nodiscard]] Array indices() const;    // (F, 3) u32
  [[nodiscard]] Array normals() const;    // (V, 3) f32; empty: flat
  [[nodiscard]] Array uvs() const;        // (V, 2) f32; empty: none
};

/// A material that entities share.
class Material : public Handle {
 public:
  static constexpr Kind kKind = Kind::kMaterial;
  using Handle::Handle;

  /// Maps each numeric parameter to its value, grey as a colour; one that a texture drives gives
  /// its factor.
  [[nodiscard]] std::map<std::string, Color> parameters() const;
};

/// An image with its sampler.
class Texture : public Handle {
 public:
  static constexpr Kind kKind = Kind::kTexture;
  using Handle::Handle;
};

/// A medium that entities share: smoke, clouds, fire.
class Volume : public Handle {
 public:
  static constexpr Kind kKind = Kind::kVolume;
  using Handle::Handle;
};

/// Entities that belong together: "<name>/0" .. of Edits::instances, or any.
using Group = std::vector<Entity>;

namespace wire {
struct AssetState;
}

/// A decoded file and where it was placed. Copies are the same asset.
class Asset {
 public:
  explicit Asset(std::shared_ptr<wire::AssetState> state) : state_(std::move(state)) {}

  [[nodiscard]] const std::string& name() const;
  [[nodiscard]] Entity root() const;     // of the first placement
  [[nodiscard]] Group roots() const;     // one a placement
  [[nodiscard]] Group entities() const;  // of the first placement, its root first
  [[nodiscard]] Group cameras() const;   // the ones with a camera
  /// Finds an object by its name in the file; kNotFound lists the names.
  [[nodiscard]] Mesh mesh(const std::string& name) const;
  [[nodiscard]] Material material(const std::string& name) const;
  [[nodiscard]] Texture texture(const std::string& name) const;
  [[nodiscard]] const std::vector<std::string>& materials() const;  // names in the file
  [[nodiscard]] const std::vector<std::string>& animations() const;
  [[nodiscard]] const std::vector<std::string>& warnings() const;
  /// The rest box, metres: lower and upper corner.
  [[nodiscard]] std::optional<std::array<Vec3, 2>> bounds() const;

  [[nodiscard]] const std::shared_ptr<wire::AssetState>& state() const { return state_; }

 private:
  std::shared_ptr<wire::AssetState> state_;
};

}  // namespace heliograph::client
