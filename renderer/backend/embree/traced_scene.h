// What Embree's answers to rays need of a scene.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

struct TracedScene {
  RTCScene top = nullptr;                     // null: nothing to hit
  const RTCScene* instance_scenes = nullptr;  // by instance: the scene its mesh lies in
  const kernels::SceneView* view = nullptr;
  // The static entities, one instance of the top level: by geometry within it, their instances.
  kernels::u32 group = kernels::kNone;
  const kernels::u32* group_instances = nullptr;

  [[nodiscard]] kernels::u32 instance_of(kernels::u32 instance, kernels::u32 geometry) const {
    return instance == group ? group_instances[geometry] : instance;
  }
  [[nodiscard]] kernels::u32 instance_of(const RTCHit& hit) const {
    return instance_of(hit.instID[0], hit.geomID);
  }
};

}  // namespace heliograph::embree
