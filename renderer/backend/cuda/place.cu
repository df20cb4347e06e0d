// The GPU program that makes instances of slots and of poses.
#include "renderer/backend/cuda/lanes.h"
#include "renderer/backend/cuda/place_launch.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

extern "C" __global__ void __launch_bounds__(kPlaceThreads)
    place_instances(const __grid_constant__ PlaceLaunch l) {
  const u32 i = thread();
  if (i >= l.count) return;
  const SlotView& slot = l.slots[i];
  l.instances[i] = placed(slot, l.world[slot.entity], l.motion_keys);
}
