// Builds apart from other tasks, with Embree's progress monitor.
#include "renderer/backend/embree/commit.h"

#include <string>

#include "renderer/base/parallel.h"

namespace heliograph::embree {

RTCError commit(RTCScene scene, RTCDevice device) {
  tbb::task_arena here(tbb::task_arena::attach{});  // tasks begin anew in it, below no other
  return run_in(here, [&] {
    rtcCommitScene(scene);
    return rtcGetDeviceError(device);
  });
}

Status commit(RTCScene scene, RTCDevice device, const Interrupt& interrupt) {
  HELIO_TRY(interrupt.status());
  const auto go_on = [](void* asked, double) {
    return !static_cast<const Interrupt*>(asked)->requested();
  };
  rtcSetSceneProgressMonitorFunction(scene, go_on, const_cast<Interrupt*>(&interrupt));
  const RTCError error = commit(scene, device);
  rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  HELIO_TRY(interrupt.status());
  if (error != RTC_ERROR_NONE)
    return fail(
        error == RTC_ERROR_OUT_OF_MEMORY ? Code::kResourceExhausted : Code::kInternal, "",
        "Embree could not build an acceleration structure: error " + std::to_string(int(error)));
  return {};
}

}  // namespace heliograph::embree
