// Embree 3 or 4 under one include, and owners for its handles. Used by this backend only.
#pragma once

#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <utility>

#include "renderer/base/box.h"

namespace heliograph::embree {

using namespace resident;

/// Owns one reference of an Embree object. A copy is another reference.
template <class H, void (*Retain)(H), void (*Release)(H)>
class Handle {
 public:
  Handle() = default;
  explicit Handle(H handle) : handle_(handle) {}  // takes over the caller's reference
  Handle(const Handle& other) : handle_(other.handle_) {
    if (handle_) Retain(handle_);
  }
  Handle(Handle&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Handle& operator=(Handle other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Handle() {
    if (handle_) Release(handle_);
  }
  [[nodiscard]] H get() const { return handle_; }
  explicit operator bool() const { return handle_ != nullptr; }

 private:
  H handle_ = nullptr;
};

using DeviceHandle = Handle<RTCDevice, rtcRetainDevice, rtcReleaseDevice>;
using SceneHandle = Handle<RTCScene, rtcRetainScene, rtcReleaseScene>;
using GeometryHandle = Handle<RTCGeometry, rtcRetainGeometry, rtcReleaseGeometry>;

[[nodiscard]] inline Box bounds_of(RTCScene scene) {
  RTCBounds bounds;
  rtcGetSceneBounds(scene, &bounds);
  Box box;
  box.lower = {bounds.lower_x, bounds.lower_y, bounds.lower_z};
  box.upper = {bounds.upper_x, bounds.upper_y, bounds.upper_z};
  return box;
}

/// A scene whose queries may bring a filter of their own: cut-outs are decided ray by ray.
inline SceneHandle new_scene(RTCDevice device) {
  SceneHandle scene(rtcNewScene(device));
#if RTC_VERSION_MAJOR >= 4
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS);
#else
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_CONTEXT_FILTER_FUNCTION);
#endif
  return scene;
}

}  // namespace heliograph::embree
