// Motion keys to Embree's quaternion decompositions.
#include "renderer/backend/embree/instance_motion.h"

#include <cmath>
#include <cstring>

namespace heliograph::embree {

bool usable_key(const kernels::MotionKey& key) {
  const float det = key.xx * key.yy * key.zz;
  const auto& t = key.translation;
  return std::isfinite(det) && det != 0 && std::isfinite(t.x + t.y + t.z);
}

bool same_keys(std::span<const kernels::MotionKey> a, std::span<const kernels::MotionKey> b) {
  return a.size() == b.size() &&
         (a.empty() || std::memcmp(a.data(), b.data(), a.size_bytes()) == 0);
}

void set_motion(RTCGeometry instance, std::span<const kernels::MotionKey> keys) {
  rtcSetGeometryTimeStepCount(instance, unsigned(keys.size()));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    const kernels::MotionKey& key = keys[i];
    RTCQuaternionDecomposition step;
    rtcInitQuaternionDecomposition(&step);
    rtcQuaternionDecompositionSetScale(&step, key.xx, key.yy, key.zz);
    rtcQuaternionDecompositionSetSkew(&step, key.xy, key.xz, key.yz);
    rtcQuaternionDecompositionSetQuaternion(&step, key.rotation.w, key.rotation.x, key.rotation.y,
                                            key.rotation.z);
    rtcQuaternionDecompositionSetTranslation(&step, key.translation.x, key.translation.y,
                                             key.translation.z);
    rtcSetGeometryTransformQuaternion(instance, unsigned(i), &step);
  }
}

}  // namespace heliograph::embree
