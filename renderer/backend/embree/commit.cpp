// One build with Embree's progress monitor.
#include "renderer/backend/embree/commit.h"

namespace heliograph::embree {

Status commit(RTCScene scene, RTCDevice device, const Interrupt& interrupt) {
  HELIO_TRY(interrupt.status());
  const auto go_on = [](void* asked, double) {
    return !static_cast<const Interrupt*>(asked)->requested();
  };
  rtcSetSceneProgressMonitorFunction(scene, go_on, const_cast<Interrupt*>(&interrupt));
  rtcCommitScene(scene);
  rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  const RTCError error = rtcGetDeviceError(device);
  HELIO_TRY(interrupt.status());
  if (error != RTC_ERROR_NONE)
    return fail(Code::kResourceExhausted, "",
                "Embree could not build the acceleration structure of the scene");
  return {};
}

}  // namespace heliograph::embree
