// Lights without a mesh of their own: the mesh that stands for their shape.
#pragma once

#include "renderer/scene/snapshot.h"

namespace heliograph {

inline constexpr u32 kLightShapes = 3;

/// The unit shape, facing -Z: a square of side 1, a disc or a sphere of radius 1. A disc and a
/// sphere have one triangle, which carries their texture coordinates; rays meet the shape itself.
/// shape: not kMesh. Lives as long as the program.
[[nodiscard]] const Mesh* shape_mesh(LightShape shape);

/// What an entity shows: its own mesh, or the shape of its light; null: nothing.
[[nodiscard]] const Mesh* shown_mesh(const Snapshot& snapshot, const Entity& entity);

/// Whether its light has a shape of its own.
[[nodiscard]] bool has_light_shape(const Entity& entity);

/// Whether a light has a strength and a colour.
[[nodiscard]] bool emits(const Light& light);

/// Size of what an entity shows over that of its mesh, along the axes.
[[nodiscard]] vec3 shown_scale(const Entity& entity);

}  // namespace heliograph
