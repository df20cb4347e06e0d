// Entities that are marked as static, in one acceleration structure in world space: rays meet them
// without a change of coordinates, and their boxes do not overlap. Called by top_level.cpp.
#pragma once

#include "renderer/backend/embree/instance_geometry.h"
#include "renderer/device/backend.h"
#include "renderer/placement/static_members.h"

namespace heliograph::embree {

struct StaticGroup {
  std::vector<StaticMember> members;
  std::vector<u32> slots;  // by number of the geometry within the scene
  SceneHandle scene;
  InstanceGeometry instance;  // of the scene, for a top level
  [[nodiscard]] u64 bytes() const;
};

/// Builds the group, or takes over the acceleration structure of `before` where it is the same.
/// Null without members. Fails with RESOURCE_EXHAUSTED, and as the interrupt does.
[[nodiscard]] Expected<std::shared_ptr<const StaticGroup>> make_static_group(
    std::vector<StaticMember> members, const std::shared_ptr<const StaticGroup>& before,
    RTCDevice device, const Interrupt& interrupt);

}  // namespace heliograph::embree
