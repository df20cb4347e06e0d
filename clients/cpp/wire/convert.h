// Public values to messages and back. Called by edits and reads.
#pragma once

#include <string>

#include "heliograph/components.h"
#include "heliograph/edit.h"
#include "heliograph/geometry.h"
#include "heliograph/material.h"
#include "heliograph/render.h"
#include "heliograph/v1/service.pb.h"
#include "wire/draft.h"

namespace heliograph::client::wire {

v1::Vec3 to_proto(Vec3 v);
v1::Vec3 to_proto(Color c);
inline Color to_color(const v1::Vec3& v) { return {double(v.x()), double(v.y()), double(v.z())}; }
/// (4, 4) f32
void put_matrix(const Mat4& matrix, v1::Array* out);
void put_pose(const Pose& pose, v1::Pose* out);
void put_texture_use(const TextureUse& use, const Draft& draft, const std::string& field,
                     v1::TextureUse* out);

void put_entity(const Components& components, Draft& draft, v1::Entity* out);
void put_label(const Components::Fields& given, v1::Entity* out);
void put_camera(const Camera& camera, Draft& draft, v1::Camera* out);
Camera camera_of(const v1::Camera& message);  // without the rays of a table
void put_light(const Light& light, const Draft& draft, v1::Light* out);
Light light_of(const v1::Light& message);  // without its textures
void put_material(const Parameters& parameters, const Draft& draft, v1::Material* out);
void put_mesh(const Geometry& geometry, Draft& draft, v1::Mesh* out);
void put_volume(const Medium& medium, Draft& draft, v1::Volume* out);
void put_image(const Image& image, Draft& draft, v1::Texture* out);
void put_dome(const Dome& dome, v1::Dome* out);

/// server   of the daemon that is asked: it reports which planes are averaged
v1::RenderRequest to_request(const v1::GetServerInfoReply& server, std::uint64_t scene,
                             const std::vector<Ref>& cameras, const RenderOptions& options);

/// An array that changes. An overlay is used more than once, an upload only once.
void put_edited(const Array& array, Draft& draft, v1::Array* out);
void put_asset(const Array& array, Draft& draft, v1::Array* out);

}  // namespace heliograph::client::wire
