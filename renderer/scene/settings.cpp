// The dome, the scene's time, its classes, and advancing the time. Called by apply().
#include <algorithm>
#include <cmath>

#include "renderer/scene/draft.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// Moves the time; poses of keyed entities follow it.
void set_time(Snapshot& scene, Time time) {
  scene.time = time;
  if (scene.keyed == 0) return;
  for (u32 i = 0; i < scene.entities.capacity(); ++i) {
    if (!scene.entities.alive(i) || !scene.entities.at(i).keys) continue;
    const mat4x3 pose = local_pose(scene, i, time);
    if (scene.poses[i] != pose) scene.poses.write(i) = pose;
  }
}

Status put_dome(Draft& draft, const Scope& scope, const PutDome& patch) {
  const Dome before = draft.next.dome ? *draft.next.dome : Dome{};
  Dome dome = before;
  if (patch.texture) HELIO_TRY(scope.bind(*patch.texture, "dome.texture", dome.texture));
  if (patch.color) dome.color = *patch.color;
  if (patch.intensity) dome.intensity = *patch.intensity;
  if (patch.world_from_dome) dome.world_from_dome = *patch.world_from_dome;
  if (patch.camera_visible) dome.camera_visible = *patch.camera_visible;
  if (patch.light_group) dome.light_group = *patch.light_group;
  count(draft, before, dome);
  draft.next.dome = std::make_shared<const Dome>(dome);
  return {};
}

}  // namespace

Status put(Draft& draft, const Scope& scope, const PutSettings& patch) {
  if (patch.time && *patch.time != draft.next.time) {
    draft.next.previous = nullptr;
    set_time(draft.next, *patch.time);
  }
  for (const std::string& category : patch.categories) {
    u32 id = 0;
    register_category(draft, category, id);
  }
  if (patch.dome) HELIO_TRY(put_dome(draft, scope, *patch.dome));
  return {};
}

Status advance(Draft& draft, const Advance& action) {
  const Time time = draft.next.time + action.dt;
  if (!(time > draft.next.time) || !std::isfinite(time))
    return fail(Code::kInvalidArgument, "dt", "dt has to move the time on, to a finite value");
  draft.next.previous = nullptr;
  draft.next.previous = std::make_shared<const Snapshot>(draft.next);
  ++draft.next.advances;
  set_time(draft.next, time);
  return {};
}

}  // namespace heliograph
