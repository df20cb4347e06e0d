#include "heliograph/rigs.h"

#include "heliograph/error.h"

namespace heliograph::client {

Rig stereo(Transaction& edit, const std::string& name, const Camera& camera, double baseline,
           const Components& placement) {
  if (!(baseline > 0))
    throw ClientError(Code::kInvalidArgument, "baseline: must be above 0 metres", {"baseline"});
  Rig rig;
  rig.root = edit.entity(name, placement);
  const auto eye = [&](const char* side, double x) {
    return edit.entity(name + side,
                       Components().parent(rig.root).camera(camera).transform(Vec3{x, 0, 0}));
  };
  rig.left = eye("/left", -0.5 * baseline);
  rig.right = eye("/right", 0.5 * baseline);
  return rig;
}

}  // namespace heliograph::client
