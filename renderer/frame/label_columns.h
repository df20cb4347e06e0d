// Label columns of a frame: arithmetic on the snapshot and on what a backend traced. Called by
// backends.
#pragma once

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "renderer/frame/frame.h"
#include "renderer/frame/image_camera.h"
#include "renderer/scene/labels.h"

namespace heliograph {

/// The frame that an instance's labels refer to: rotation and translation of its root entity.
struct ObjectFrame {
  glm::dmat4 world_from_object{1};  // R orthonormal, det +1
  vec3 scale{1};                    // of the root entity along the object's axes
  bool rigid = true;                // false: the parents shear or mirror
};
[[nodiscard]] ObjectFrame object_frame(const mat4x3& world_from_root);

/// An axis-aligned box in an ObjectFrame, metres; empty while lower > upper.
struct RestBox {
  vec3 lower{INFINITY};
  vec3 upper{-INFINITY};
  [[nodiscard]] bool empty() const { return !(lower.x <= upper.x); }
};

/// Half-open pixel box [x0, x1) x [y0, y1); all 0 when there is no pixel.
struct PixelBox {
  i32 x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  void extend(i32 x, i32 y) {
    if (x1 == x0) {
      *this = {x, y, x + 1, y + 1};
      return;
    }
    x0 = std::min(x0, x);
    y0 = std::min(y0, y);
    x1 = std::max(x1, x + 1);
    y1 = std::max(y1, y + 1);
  }
};

/// An instance alone, whatever hides it.
struct Silhouette {
  u32 inside = 0;  // pixels within the image
  u32 canvas = 0;  // pixels on the canvas
  PixelBox box_inside;
  PixelBox box_canvas;
  std::vector<u8> mask;  // of the image, bit-packed most significant first; empty unless asked for
};

struct KeypointLabel {
  enum class State : u8 { kOutside = 0, kOccluded = 1, kSelfOccluded = 2, kVisible = 3 };
  u32 instance = 0;  // label
  std::string name;
  vec3 p_camera{0};  // OpenCV camera frame, metres
  vec2 p_image{0};   // K coordinates; NaN behind the camera
  State state = State::kOutside;
};

/// Inputs of the columns. Spans by row follow Labelling::instances.
struct LabelInputs {
  const Snapshot& snapshot;
  const Labelling& labelling;
  const ImageCamera& camera;
  std::span<const ObjectFrame> frames;       // by row, at the label time
  std::span<const RestBox> boxes;            // by row
  std::span<const u32> instance_plane;       // width * height labels; empty: no pixel columns
  std::span<const Silhouette> silhouettes;   // by row; empty: no amodal columns
  std::span<const KeypointLabel> keypoints;  // ordered by instance
  LabelOptions options;
};

/// The columns, one row an instance ordered by label; keypoint columns have one row a keypoint:
///   label u32 · name text · category u32 · entity u64 · attributes text (JSON)
///   world_from_object, camera_from_object_cv (N, 4, 4) f64 rigid · scale (N, 3) f32 · rigid u8
///   box_center, box_half_extents (N, 3) f32, object frame, metres, scale contained
///   corners_camera (N, 8, 3) f32 · corners_image (N, 8, 2) f32 K coordinates, NaN behind the
///   camera;
///     corner i has the upper x where i & 1, the upper y where i & 2, the upper z where i & 4
///   crosses_camera_plane u8 · visible u32 · bbox_visible (N, 4) i32 x0 y0 x1 y1
///   inside, canvas u32 · visibility, occlusion, truncation f32 · bbox_amodal, bbox_amodal_canvas
///   amodal_masks (N, ceil(H W / 8)) u8
///   keypoint_instance u32 · keypoint_name text · keypoint_position_camera (K, 3) f32
///   keypoint_image (K, 2) f32 · keypoint_state u8 (KeypointLabel::State)
[[nodiscard]] std::vector<Column> label_columns(const LabelInputs& inputs);

}  // namespace heliograph
