// Parts of a scene that Embree's answers to rays need.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// RTCHit::instID of what is met in the static group, which lies in the world.
inline constexpr kernels::u32 kStaticGroup = RTC_INVALID_GEOMETRY_ID;

struct TracedScene {
  RTCScene top = nullptr;                     // null: nothing to hit
  const RTCScene* instance_scenes = nullptr;  // by instance: the scene its mesh lies in
  const kernels::SceneView* view = nullptr;
  // By geometry within the static group, their instances.
  const kernels::u32* group_instances = nullptr;

  [[nodiscard]] kernels::u32 instance_of(kernels::u32 instance, kernels::u32 geometry) const {
    return instance == kStaticGroup ? group_instances[geometry] : instance;
  }
  [[nodiscard]] kernels::u32 instance_of(const RTCHit& hit) const {
    return instance_of(hit.instID[0], hit.geomID);
  }
};

}  // namespace heliograph::embree
