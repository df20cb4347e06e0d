// Meshes, volumes, textures and the dome.
#include <algorithm>
#include <array>
#include <utility>

#include "wire/arrays.h"
#include "wire/assets.h"
#include "wire/convert.h"
#include "wire/session.h"
#include "wire/uploads.h"

namespace heliograph::client::wire {
namespace {

void put_topology(const Geometry& geometry, Draft& draft, v1::Mesh* out) {
  const std::pair<const Array*, v1::Array* (v1::Mesh::*)()> arrays[] = {
      {&geometry.indices, &v1::Mesh::mutable_indices},
      {&geometry.uvs, &v1::Mesh::mutable_uvs},
      {&geometry.uvs1, &v1::Mesh::mutable_uvs1},
      {&geometry.colors, &v1::Mesh::mutable_colors},
      {&geometry.tangents, &v1::Mesh::mutable_tangents},
      {&geometry.parts, &v1::Mesh::mutable_parts},
      {&geometry.joints, &v1::Mesh::mutable_joints},
      {&geometry.weights, &v1::Mesh::mutable_weights},
      {&geometry.morph_positions, &v1::Mesh::mutable_morph_positions},
      {&geometry.morph_normals, &v1::Mesh::mutable_morph_normals},
      {&geometry.skeleton, &v1::Mesh::mutable_skeleton},
      {&geometry.curves, &v1::Mesh::mutable_curves},
      {&geometry.radii, &v1::Mesh::mutable_radii},
  };
  for (const auto& [array, field] : arrays)
    if (!array->empty()) put_asset(*array, draft, (out->*field)());
}

void put_symmetry(const Symmetry& symmetry, v1::Symmetry* out) {
  if (symmetry.matrix) put_matrix(*symmetry.matrix, out->mutable_matrix());
  if (!symmetry.axis) return;
  *out->mutable_axis() = to_proto(*symmetry.axis);
  *out->mutable_offset() = to_proto(symmetry.offset);
}

/// Puts a grid, which fills the box that the density's voxels make.
void put_grid(const Medium& medium, const Array& values, Draft& draft, v1::Grid* out) {
  const std::array<double, 3> size{medium.voxel_size.x, medium.voxel_size.y, medium.voxel_size.z};
  const std::array<double, 3> origin{medium.origin.x, medium.origin.y, medium.origin.z};
  Mat4 matrix = Mat4::identity();
  for (std::size_t i = 0; i < 3; ++i) {
    const double box = size[i] * double(medium.density.shape()[i]);
    matrix(i, i) = box / double(std::max<std::size_t>(1, values.shape()[i]));
    matrix(i, 3) = origin[i];
  }
  put_asset(as_f32(values, "volume"), draft, out->mutable_values());
  put_inline(Array::borrow(matrix.rows[0].data(), {4, 4}), out->mutable_transform());
}

void check_grid(const Array& values, std::size_t dimensions, const std::string& field) {
  if (values.empty() || values.shape().size() == dimensions) return;
  throw ClientError(Code::kInvalidArgument,
                    field + ": needs " + std::to_string(dimensions) + " dimensions, has shape " +
                        to_string(values.shape()) + "; reshape it",
                    {field});
}

}  // namespace

void put_edited(const Array& array, Draft& draft, v1::Array* out) {
  Uploads& uploads = draft.scene->session->uploads();
  draft.publish ? uploads.put_edited(array, out) : uploads.put_asset(array, out);
}

void put_asset(const Array& array, Draft& draft, v1::Array* out) {
  draft.scene->session->uploads().put_asset(array, out);
}

void put_mesh(const Geometry& geometry, Draft& draft, v1::Mesh* out) {
  if (!geometry.positions.empty()) put_edited(geometry.positions, draft, out->mutable_positions());
  if (!geometry.normals.empty()) put_edited(geometry.normals, draft, out->mutable_normals());
  if (!geometry.times.empty()) put_inline(Array(geometry.times), out->mutable_times());
  put_topology(geometry, draft, out);
  for (const std::string& name : geometry.part_names) out->add_part_names(name);
  for (const auto& [name, position] : geometry.keypoints) {
    v1::Keypoint* keypoint = out->add_keypoints();
    keypoint->set_name(name);
    *keypoint->mutable_position() = to_proto(position);
  }
  for (const Symmetry& symmetry : geometry.symmetries)
    put_symmetry(symmetry, out->add_symmetries());
}

void put_volume(const Medium& medium, Draft& draft, v1::Volume* out) {
  check_grid(medium.density, 3, "density");
  check_grid(medium.temperature, 3, "temperature");
  check_grid(medium.color, 4, "color");
  if (medium.density.empty() && !(medium.temperature.empty() && medium.color.empty()))
    throw ClientError(Code::kInvalidArgument,
                      "density: is missing; give it with the grids that fill its box", {"density"});
  if (!medium.density.empty()) put_grid(medium, medium.density, draft, out->mutable_density());
  if (!medium.temperature.empty())
    put_grid(medium, medium.temperature, draft, out->mutable_temperature());
  if (!medium.color.empty()) put_grid(medium, medium.color, draft, out->mutable_color());
  if (medium.density_scale) out->set_density_scale(float(*medium.density_scale));
  if (medium.albedo) *out->mutable_albedo() = to_proto(*medium.albedo);
  if (medium.anisotropy) out->set_anisotropy(float(*medium.anisotropy));
  if (medium.temperature_scale) out->set_temperature_scale(float(*medium.temperature_scale));
  if (medium.emission_scale) out->set_emission_scale(float(*medium.emission_scale));
  for (const std::string& name : medium.reset) out->add_clear(name);
}

void put_image(const Image& image, Draft& draft, v1::Texture* out) {
  if (!image.path.empty()) {
    const v1::AssetInfo info =
        decode_bundle(*draft.scene->session, {image.path, "", "", 0, image.layer});
    for (const std::string& text : info.warnings())
      draft.warnings.push_back(image.path + ": " + text);
    if (!info.has_texels())
      throw ClientError(Code::kInvalidArgument,
                        "image: " + image.path + " is no picture; use import_file()", {"image"});
    *out->mutable_texels() = info.texels();
    out->set_encoding(info.encoding());
  } else if (!image.texels.empty()) {
    put_asset(image.texels, draft, out->mutable_texels());
  }
  if (image.encoding) out->set_encoding(v1::Texture::Encoding(int(*image.encoding)));
  if (image.wrap_u) out->set_wrap_u(v1::Texture::Wrap(int(*image.wrap_u)));
  if (image.wrap_v) out->set_wrap_v(v1::Texture::Wrap(int(*image.wrap_v)));
  if (image.filter) out->set_filter(v1::Texture::Filter(int(*image.filter)));
}

void put_dome(const Dome& dome, v1::Dome* out) {
  if (dome.color) *out->mutable_color() = to_proto(*dome.color);
  if (dome.intensity) out->set_intensity(float(*dome.intensity));
  if (dome.rotation)
    put_inline(as_f32(Array::borrow(dome.rotation->rows[0].data(), {3, 3}), "rotation"),
               out->mutable_rotation());
  if (dome.camera_visible) out->set_camera_visible(*dome.camera_visible);
  if (dome.light_group) out->set_light_group(*dome.light_group);
  for (const std::string& name : dome.reset) out->add_clear(name);
}

}  // namespace heliograph::client::wire
