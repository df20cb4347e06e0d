// See scene_info.h.
#include "server/scene_info.h"

namespace heliograph::server {

v1::SceneInfo scene_info(Scenes& scenes, SceneEntry& scene, const Session& session) {
  const auto head = scene.scene.head();
  v1::SceneInfo info;
  info.set_scene(scene.id);
  info.set_name(scene.name);
  info.set_revision(head->revision);
  info.set_shared(scene.owner == 0);
  info.set_durability("none");
  info.set_time(head->time);
  info.set_next_edit(scenes.next_edit(scene, session.id()));
  return info;
}

}  // namespace heliograph::server
