// Who answers single rays on the host, and a scene with it. Called for labels and questions;
// implemented by backends.
#pragma once

#include "renderer/host/ray_packet.h"
#include "renderer/resident/scene.h"

namespace heliograph::host {

using namespace resident;

/// A kernels::Tracer whose scene is chosen at run time; it borrows the scene. Thread: any.
class HostTracer {
 public:
  virtual ~HostTracer() = default;
  [[nodiscard]] virtual kernels::Hit closest(const kernels::Ray& ray, u32 mask) const = 0;
  [[nodiscard]] virtual bool occluded(const kernels::Ray& ray, u32 mask) const = 0;
  [[nodiscard]] virtual kernels::Hit closest_in(u32 instance, const kernels::Ray& ray) const = 0;
  /// True if a ray of object space, its direction of any length, meets one instance alone.
  [[nodiscard]] virtual bool meets(u32 instance, const kernels::Ray& ray_object) const = 0;
  /// The same of an instance without holes, for those rays of a packet whose bits are in `lanes`.
  /// Returns a bit for each.
  [[nodiscard]] virtual u32 meets_of(u32 instance, const RayPacket& rays_object, u32 lanes) const;
};

/// A scene and who answers its rays.
struct SceneRays {
  std::shared_ptr<const ResidentScene> scene;
  std::unique_ptr<const HostTracer> tracer;
};

}  // namespace heliograph::host
