// Result of a job: planes and label columns, immutable.
#pragma once

#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "renderer/base/error.h"
#include "renderer/frame/job.h"

namespace heliograph {

enum class DType : u8 { kU8, kU16, kU32, kI32, kU64, kF16, kF32, kF64 };
[[nodiscard]] std::size_t size_of(DType type);
template <class T>
constexpr DType dtype_of() {
  if constexpr (std::is_same_v<T, u8>) return DType::kU8;
  if constexpr (std::is_same_v<T, u32>) return DType::kU32;
  if constexpr (std::is_same_v<T, i32>) return DType::kI32;
  if constexpr (std::is_same_v<T, u64>) return DType::kU64;
  if constexpr (std::is_same_v<T, float>) return DType::kF32;
  if constexpr (std::is_same_v<T, double>) return DType::kF64;
}

/// Description of a plane as sent to clients; derived from HELIO_PLANES.
struct PlaneInfo {
  const char* name;  // lower case
  DType dtype;
  u32 channels;
  const char* unit;
  kernels::Fold fold;
};
[[nodiscard]] const PlaneInfo& plane_info(Plane plane);

/// A dense array with its shape; or, without one, text, one string a row.
struct Column {
  std::string name;
  DType dtype = DType::kF32;  // of data
  std::vector<u64> shape;     // the first dimension is one row an instance
  std::vector<std::byte> data;
  std::vector<std::string> strings;
};

struct PlaneData {
  Plane plane{};
  Pixels pixels;
};
/// A plane of a job, of so many pixels; not initialised. What the job asked for goes where its
/// reader has it.
[[nodiscard]] PlaneData new_plane(const RenderJob& job, Plane plane, u64 pixels);
/// The same in the device's memory, of a job that wants its planes there. RESOURCE_EXHAUSTED when
/// there is none.
[[nodiscard]] Expected<PlaneData> new_device_plane(const RenderJob& job, Plane plane, u64 pixels);

/// Differences of the pictures of a frame of worlds; of R worlds and C cameras.
struct WorldPictures {
  std::vector<u32> worlds;                       // R, ascending
  std::vector<u64> seeds;                        // R
  std::vector<std::string> cameras;              // C
  std::vector<Shutter> shutters;                 // (R, C)
  std::vector<glm::dmat3> k;                     // (R, C)
  std::vector<glm::dmat4> camera_from_world_cv;  // (R, C)
};

struct Frame {
  u32 index = 0;  // over the job's cameras
  u64 scene = 0;
  Revision revision = 0;
  u64 overlay = 0;
  std::string camera;
  u32 width = 0, height = 0;
  Time time = 0;
  Time label_time = 0;  // of row 0; row y is shutter.rolling * y / (height - 1) later
  Shutter shutter;
  u64 seed = 0;
  u32 samples = 0;
  bool final = true;
  glm::dmat3 k{1};  // intrinsics at the rendered size
  glm::dmat4 camera_from_world_cv{1};
  std::vector<PlaneData> planes;  // in the order of the job
  std::vector<Column> labels;
  std::vector<std::string> categories;  // class id - 1 -> name
  std::vector<std::string> warnings;
  std::string denoiser;  // who made DENOISED
  double render_seconds = 0;
  u64 rays = 0;
  double noise = std::numeric_limits<double>::quiet_NaN();  // mean relative standard error
  u64 tile_rounds = 0;                                      // of an adaptive frame
  // Null: one picture. Otherwise planes are (R, C, height, width, channels), labels those of all
  // pictures, and camera, shutter, k and camera_from_world_cv mean nothing.
  std::shared_ptr<const WorldPictures> worlds;
};

struct Progress {
  double done = 0;  // [0, 1]
  double rays_per_second = 0;
  double eta_seconds = 0;
  double noise = 0;  // NaN until known
};

}  // namespace heliograph
