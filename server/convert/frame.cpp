// Frame to FrameHeader and bytes.
#include "server/convert/frame.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "renderer/base/half.h"
#include "renderer/frame/film_planes.h"
#include "server/convert/nouns.h"
#include "server/convert/render.h"

namespace heliograph::server {
namespace {

v1::Fold to_proto(kernels::Fold fold) {
  switch (fold) {
    case kernels::Fold::kMean:
      return v1::FOLD_MEAN;
    case kernels::Fold::kCentre:
      return v1::FOLD_CENTRE;
    case kernels::Fold::kFilm:
      return v1::FOLD_FILM;
    case kernels::Fold::kPost:
      return v1::FOLD_POST;
  }
  return v1::FOLD_UNSPECIFIED;
}

template <class T>
v1::Array inline_array(v1::DType type, const std::vector<u64>& shape,
                       const std::vector<T>& values) {
  v1::Array array;
  array.set_dtype(type);
  array.mutable_shape()->Add(shape.begin(), shape.end());
  array.set_inline_(values.data(), values.size() * sizeof(T));
  return array;
}

/// Converts square matrices to row-major f64; `shape` are the leading dimensions.
template <class Matrix>
v1::Array matrix_array(std::span<const Matrix> matrices, std::vector<u64> shape = {}) {
  std::vector<double> numbers;
  constexpr int n = int(Matrix::length());
  for (const Matrix& m : matrices)
    for (int row = 0; row < n; ++row)
      for (int column = 0; column < n; ++column) numbers.push_back(m[column][row]);
  shape.insert(shape.end(), 2, u64(n));
  return inline_array(v1::D_TYPE_F64, shape, numbers);
}

std::string argument_text(const v1::PlaneRequest& request) {
  if (!request.has_camera()) return request.group();
  return request.camera().has_name() ? request.camera().name()
                                     : std::to_string(request.camera().id());
}

v1::PlaneInfo to_proto(const PlaneData& data, const v1::PlaneRequest& request) {
  const PlaneInfo& info = plane_info(data.plane);
  v1::PlaneInfo message;
  message.set_plane(server::to_proto(data.plane));
  message.set_name(info.name);
  message.set_dtype(request.half() ? v1::D_TYPE_F16 : server::to_proto(info.dtype));
  message.set_channels(info.channels);
  message.set_unit(info.unit);
  message.set_fold(to_proto(info.fold));
  message.set_size(WirePlane(data, request.half()).size());
  message.set_argument(argument_text(request));
  return message;
}

/// Adds intrinsics and poses of the cameras, and the shutter.
void add_views(const Frame& frame, v1::FrameHeader& message) {
  if (!frame.worlds) {
    *message.mutable_k() = matrix_array<glm::dmat3>(std::span(&frame.k, 1));
    *message.mutable_camera_from_world_cv() =
        matrix_array<glm::dmat4>(std::span(&frame.camera_from_world_cv, 1));
    *message.mutable_shutter() = server::to_proto(frame.shutter);
    return;
  }
  const WorldPictures& pictures = *frame.worlds;
  const std::vector<u64> shape{pictures.worlds.size(), pictures.cameras.size()};
  *message.mutable_k() = matrix_array<glm::dmat3>(pictures.k, shape);
  *message.mutable_camera_from_world_cv() =
      matrix_array<glm::dmat4>(pictures.camera_from_world_cv, shape);
  v1::FrameWorlds& worlds = *message.mutable_worlds();
  *worlds.mutable_worlds() = inline_array(v1::D_TYPE_U32, {shape[0]}, pictures.worlds);
  *worlds.mutable_seeds() = inline_array(v1::D_TYPE_U64, {shape[0]}, pictures.seeds);
  worlds.mutable_cameras()->Add(pictures.cameras.begin(), pictures.cameras.end());
  if (std::ranges::any_of(pictures.shutters, [](const Shutter& s) { return s != Shutter{}; }))
    for (const Shutter& shutter : pictures.shutters)
      *worlds.add_shutters() = server::to_proto(shutter);
}

}  // namespace

v1::PlaneKind plane_kind(Plane plane) {
  const PlaneInfo& info = plane_info(plane);
  v1::PlaneKind message;
  message.set_plane(to_proto(plane));
  message.set_dtype(to_proto(info.dtype));
  message.set_channels(info.channels);
  message.set_unit(info.unit);
  message.set_fold(to_proto(info.fold));
  message.set_averaged(is_averaged(plane));
  return message;
}

v1::DType to_proto(DType type) {
  static constexpr std::array kTypes{v1::D_TYPE_U8,  v1::D_TYPE_U16, v1::D_TYPE_U32,
                                     v1::D_TYPE_I32, v1::D_TYPE_U64, v1::D_TYPE_F16,
                                     v1::D_TYPE_F32, v1::D_TYPE_F64};
  return kTypes[std::size_t(type)];
}

v1::LabelColumn to_proto(const Column& column) {
  v1::LabelColumn message;
  message.set_name(column.name);
  if (!column.shape.empty()) message.set_dtype(to_proto(column.dtype));
  message.mutable_shape()->Add(column.shape.begin(), column.shape.end());
  message.set_data(column.data.data(), column.data.size());
  message.mutable_strings()->Add(column.strings.begin(), column.strings.end());
  return message;
}

v1::Progress to_proto(const Progress& progress) {
  v1::Progress message;
  message.set_done(progress.done);
  message.set_rays_per_second(progress.rays_per_second);
  message.set_eta_seconds(progress.eta_seconds);
  message.set_noise(progress.noise);
  return message;
}

v1::FrameHeader to_header(const Frame& frame, const FrameContext& context) {
  v1::FrameHeader message;
  message.set_frame(frame.index);
  message.set_scene(frame.scene);
  message.set_revision(frame.revision);
  message.set_overlay(frame.overlay);
  message.set_camera(frame.camera);
  message.set_width(frame.width);
  message.set_height(frame.height);
  message.set_time(frame.time);
  message.set_seed(frame.seed);
  message.set_samples(frame.samples);
  message.set_final(frame.final);
  message.set_backend(context.backend);
  message.set_cpu_features(context.cpu_features);
  add_views(frame, message);
  for (std::size_t i = 0; i < frame.planes.size(); ++i)
    *message.add_planes() = to_proto(frame.planes[i], context.request.planes(int(i)));
  for (const Column& column : frame.labels) *message.add_labels() = to_proto(column);
  for (std::size_t i = 0; i < frame.categories.size(); ++i) {
    v1::Category* category = message.add_categories();
    category->set_id(u32(i + 1));
    category->set_name(frame.categories[i]);
  }
  message.mutable_warnings()->Add(frame.warnings.begin(), frame.warnings.end());
  message.set_render_seconds(frame.render_seconds);
  message.set_rays(frame.rays);
  message.set_noise(frame.noise);
  message.set_tile_rounds(frame.tile_rounds);
  message.set_label_time(frame.label_time);
  return message;
}

void WirePlane::round_to_half(u64 offset, std::span<std::byte> out) const {
  const std::byte* from = plane_.pixels.data() + 2 * offset;
  for (std::size_t i = 0; i < out.size() / sizeof(u16); ++i) {
    float value;
    std::memcpy(&value, from + i * sizeof value, sizeof value);
    const u16 half = half_of_float(value);
    std::memcpy(out.data() + i * sizeof half, &half, sizeof half);
  }
}

std::string WirePlane::chunk(u64 offset, u64 limit) const {
  if (!half_) {
    const auto* from = reinterpret_cast<const char*>(plane_.pixels.data() + offset);
    return {from, std::min(limit, size() - offset)};
  }
  const u64 count = std::min(std::max<u64>(limit / 2 * 2, 2), size() - offset);
  std::string bytes;
  bytes.resize_and_overwrite(count, [&](char* out, std::size_t n) {
    round_to_half(offset, std::as_writable_bytes(std::span(out, n)));
    return n;
  });
  return bytes;
}

}  // namespace heliograph::server
