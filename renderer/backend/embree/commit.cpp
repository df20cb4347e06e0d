// Builds apart from other tasks, with Embree's progress monitor.
#include "renderer/backend/embree/commit.h"

#include <string>

#include "renderer/base/parallel.h"

namespace heliograph::embree {

void commit(RTCScene scene) {
  tbb::task_arena here(tbb::task_arena::attach{});  // tasks begin anew in it, below no other
  run_in(here, [&] { rtcCommitScene(scene); });
}

Status commit(RTCScene scene, RTCDevice device, const Interrupt& interrupt) {
  HELIO_TRY(interrupt.status());
  const auto go_on = [](void* asked, double) {
    return !static_cast<const Interrupt*>(asked)->requested();
  };
  rtcSetSceneProgressMonitorFunction(scene, go_on, const_cast<Interrupt*>(&interrupt));
  commit(scene);
  rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  const RTCError error = rtcGetDeviceError(device);
  HELIO_TRY(interrupt.status());
  if (error != RTC_ERROR_NONE)
    return fail(
        error == RTC_ERROR_OUT_OF_MEMORY ? Code::kResourceExhausted : Code::kInternal, "",
        "Embree could not build an acceleration structure: error " + std::to_string(int(error)));
  return {};
}

}  // namespace heliograph::embree
