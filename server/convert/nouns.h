// The nouns of an edit, each in a file of its own: proto to patch and back. Called by edits.cpp.
#pragma once

#include "heliograph/v1/scene.pb.h"
#include "renderer/base/error.h"
#include "renderer/scene/transaction.h"
#include "server/convert/array.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

// pose.cpp
/// Reads (4, 4), (N, 4, 4) or (N, M, 4, 4) affine matrices; the last row is 0 0 0 1.
[[nodiscard]] Expected<std::vector<mat4x3>> read_affine(const v1::Array& array, ArraySource& source,
                                                        const Dims& dims);
/// The same with an invertible 3x3 part each.
[[nodiscard]] Expected<std::vector<mat4x3>> read_poses(const v1::Array& array, ArraySource& source,
                                                       const Dims& dims);
[[nodiscard]] Expected<ArrayOf<mat4x3>> read_many_poses(const v1::Array& array, ArraySource& source,
                                                        const Dims& dims);
/// Returns (N, 4, 4) f32; (4, 4) when `single`.
[[nodiscard]] v1::Array to_array(std::span<const mat4x3> matrices, bool single,
                                 const ArraySink& sink);

// texture.cpp
[[nodiscard]] Expected<TextureUsePatch> to_texture_use(const v1::TextureUse& message,
                                                       ArraySource& source, bool scalar);
[[nodiscard]] v1::TextureUse to_proto(const TextureUsePatch& patch, const ArraySink& sink);
[[nodiscard]] Expected<PutTexture> to_texture(const v1::Texture& message, ArraySource& source);
[[nodiscard]] v1::Texture to_proto(const PutTexture& patch, const ArraySink& sink);

// material.cpp
[[nodiscard]] Expected<PutMaterial> to_material(const v1::Material& message, ArraySource& source);
[[nodiscard]] v1::Material to_proto(const PutMaterial& patch, const ArraySink& sink);

// mesh.cpp, mesh_topology.cpp
[[nodiscard]] Expected<PutMesh> to_mesh(const v1::Mesh& message, ArraySource& source);
[[nodiscard]] v1::Mesh to_proto(const PutMesh& patch, const ArraySink& sink);
/// Reads everything of a mesh but positions, times and normals.
[[nodiscard]] Expected<MeshTopology> to_topology(const v1::Mesh& message, u32 vertex_count,
                                                 ArraySource& source);
void add_topology(const MeshTopology& topology, const ArraySink& sink, v1::Mesh& message);

// volume.cpp
[[nodiscard]] Expected<PutVolume> to_volume(const v1::Volume& message, ArraySource& source);
[[nodiscard]] v1::Volume to_proto(const PutVolume& patch, const ArraySink& sink);

// sensor.cpp
[[nodiscard]] Expected<RgbSensor> to_rgb_sensor(const v1::RgbSensor& message);
/// camera   the camera that it belongs to
[[nodiscard]] Expected<DepthSensor> to_depth_sensor(const v1::DepthSensor& message,
                                                    const Camera& camera);
[[nodiscard]] v1::RgbSensor to_proto(const RgbSensor& sensor);
[[nodiscard]] v1::DepthSensor to_proto(const DepthSensor& sensor);

// entity.cpp, entity_parts.cpp, camera.cpp
[[nodiscard]] Expected<PutEntity> to_entity(const v1::Entity& message, ArraySource& source);
[[nodiscard]] v1::Entity to_proto(const PutEntity& patch, const ArraySink& sink);
[[nodiscard]] Expected<LabelPatch> to_label(const v1::Label& message);
[[nodiscard]] v1::Label to_proto(const LabelPatch& patch);
[[nodiscard]] Expected<Camera> to_camera(const v1::Camera& message);
[[nodiscard]] v1::Camera to_proto(const Camera& camera);
[[nodiscard]] v1::Shutter to_proto(const Shutter& shutter);
[[nodiscard]] Expected<LightPatch> to_light(const v1::Light& message, ArraySource& source);
[[nodiscard]] v1::Light to_proto(const LightPatch& patch, const ArraySink& sink);
[[nodiscard]] Expected<Portal> to_portal(const v1::Portal& message);
[[nodiscard]] v1::Portal to_proto(const Portal& portal);
[[nodiscard]] Expected<SkinPatch> to_skin(const v1::Skin& message, ArraySource& source);
[[nodiscard]] v1::Skin to_proto(const SkinPatch& patch, const ArraySink& sink);

// dome.cpp
[[nodiscard]] Expected<PutDome> to_dome(const v1::Dome& message, ArraySource& source);
[[nodiscard]] v1::Dome to_proto(const PutDome& patch, const ArraySink& sink);

}  // namespace heliograph::server
