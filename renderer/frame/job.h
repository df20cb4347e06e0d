// Request to render: a snapshot (overlays already applied to it), cameras, planes, a stop rule.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "kernels/scene/planes.h"
#include "kernels/scene/settings.h"
#include "renderer/frame/pixels.h"
#include "renderer/scene/snapshot.h"
#include "renderer/scene/worlds.h"

namespace heliograph {

using kernels::Plane;
using kernels::PlaneSet;

struct LabelOptions {
  bool boxes = false;
  bool amodal = false;
  bool amodal_masks = false;
  bool keypoints = false;
  float canvas = 1;  // the canvas extends the image by this many sizes on each side
  std::optional<float> keypoint_radius;  // metres
  u32 max_rows = 65536;
};

struct StopRule {
  u32 spp = 0;         // 0: not set
  double seconds = 0;  // 0: not set
  double noise = 0;    // 0: not set
  bool adaptive = false;
  u64 tile_rounds = 0;  // adaptive; 0: not set
};

/// Client that asks, and its urgency: decides when work runs, never what it gives.
struct Origin {
  u64 tenant = 0;
  double weight = 1;  // of the tenant
  u64 session = 0;
  u64 scene = 0;
  i32 priority = 0;  // among the tenant's work a higher one goes first
};

struct RenderJob {
  std::shared_ptr<const Snapshot> snapshot;
  u64 scene = 0;    // for the frame's header
  u64 overlay = 0;  // hash of the overlay; 0: none
  std::vector<EntityId> cameras;
  std::vector<Plane> planes;
  EntityId disparity_camera;
  std::vector<std::string> groups;  // light groups of its BEAUTY_GROUP planes, in their order
  u32 width = 0, height = 0;        // 0: the camera's own
  Time time = 0;
  std::optional<Time> label_time;  // of labels and centre planes; absent: `time`
  double frame_interval = 0;       // 0: not set
  bool hold = false;
  StopRule stop;
  bool progressive = false;
  kernels::Settings settings{};
  LabelOptions labels;
  std::optional<std::chrono::steady_clock::time_point> deadline;
  Origin origin;
  PixelAllocator memory;                 // of the planes it asks for; absent: the heap
  bool on_device = false;                // they stay in the device's memory, and `memory` is of it
  std::shared_ptr<const Worlds> worlds;  // of the snapshot; null: one picture a camera
};

}  // namespace heliograph
