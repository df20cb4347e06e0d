// Measures of labels: frames of the labelled instances, and the boxes in them.
#pragma once

#include <optional>

#include "renderer/derived/lazy.h"
#include "renderer/device/backend.h"
#include "renderer/frame/label_columns.h"
#include "renderer/placement/structure.h"

namespace heliograph::resident {

class Placement;

/// Immutable.
struct LabelFrames {
  ChunkedArray<mat4x3> root_from_entity;  // by slot, of its mesh's coordinates
  ChunkedArray<ObjectFrame> frames;       // by row of the labelling, in the middle of the span
  ChunkedArray<RestBox> boxes;            // by row, in those frames
  // Parts of the placement, as it was when the boxes were made:
  ChunkedArray<kernels::SlotView> slots;
  std::vector<std::shared_ptr<const DeviceMesh>> meshes;
};

/// Labels of an earlier placement of the same structure, and what differs since.
struct LabelsBefore {
  std::optional<LabelFrames> labels;
  std::vector<u32> entities;  // that changed, or that something above them did; ascending
  std::vector<u32> deformed;  // slots that showed deformed meshes then, or do now; ascending
};

/// Inputs of labels.
struct LabelSources {
  const Snapshot& snapshot;
  const Placement& placement;
  const MeshBuilder& builder;
  const LabelsBefore& before;  // the result does not depend on it
};

/// Fails as the interrupt does.
[[nodiscard]] Expected<LabelFrames> make_labels(const LabelSources& sources,
                                                const Interrupt& interrupt);

/// Boxes of the slots, then of the volumes, as ProbeContext::rest_boxes.
[[nodiscard]] std::vector<kernels::RestBoxView> rest_box_views(const Snapshot& snapshot,
                                                               const Placement& placement,
                                                               const LabelFrames& labels);

}  // namespace heliograph::resident
