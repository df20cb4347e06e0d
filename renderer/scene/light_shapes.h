// Lights without a mesh of their own: the mesh that stands for their shape.
#pragma once

#include <optional>

#include "kernels/scene/scene_view.h"
#include "renderer/scene/snapshot.h"

namespace heliograph {

#define HELIO_ONE(name, primitive) +1
inline constexpr u32 kLightShapes = 0 HELIO_LIGHT_SHAPES(HELIO_ONE);
#undef HELIO_ONE

/// The unit shape, facing -Z: a square of side 1, a disc or a sphere of radius 1. What is no
/// triangles has one, which carries texture coordinates; rays meet the shape itself.
/// shape: not kMesh. Lives as long as the program.
[[nodiscard]] const Mesh* shape_mesh(LightShape shape);

/// Mesh that an entity shows: its own, or the shape of its light; null: nothing.
[[nodiscard]] const Mesh* shown_mesh(const Snapshot& snapshot, const Entity& entity);

/// True if its light has a shape of its own.
[[nodiscard]] bool has_light_shape(const Entity& entity);

/// True if a light has a strength and a colour.
[[nodiscard]] bool emits(const Light& light);

/// Primitive of a shape that rays meet.
[[nodiscard]] kernels::Shape primitive_of(LightShape shape);

/// Area of a shape whose unit shape has this pose, m^2: one side of a flat one.
[[nodiscard]] double shape_area(LightShape shape, const mat4x3& world_from_shape);

/// Area factor of a linear map where it is the same for every direction; nullopt otherwise.
[[nodiscard]] std::optional<double> area_scale(const mat4x3& m);

/// Size of what an entity shows over that of its mesh, along the axes.
[[nodiscard]] vec3 shown_scale(const Entity& entity);

}  // namespace heliograph
