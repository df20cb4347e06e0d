#include "renderer/frame/frame_header.h"

#include "renderer/frame/check.h"
#include "renderer/frame/shutter.h"
#include "renderer/scene/motion.h"

namespace heliograph {

ImageCamera image_of(const RenderJob& job, u32 camera) {
  const EntityId id = job.cameras[camera];
  const uvec2 size = rendered_size(job, id);
  const Camera& model = *job.snapshot->find(id)->camera;
  const Time middle = label_span(model.shutter, label_time(job)).middle();
  return image_camera(model, world_pose(*job.snapshot, id.index(), middle), size.x, size.y);
}

Frame frame_header(const RenderJob& job, u32 camera) {
  const Snapshot& snapshot = *job.snapshot;
  const EntityId id = job.cameras[camera];
  const ImageCamera image = image_of(job, camera);
  Frame frame;
  frame.index = camera;
  frame.scene = job.scene;
  frame.revision = snapshot.revision;
  frame.overlay = job.overlay;
  frame.camera = snapshot.name_of(id);
  frame.width = image.width;
  frame.height = image.height;
  frame.time = job.time;
  frame.label_time = label_time(job);
  frame.shutter = snapshot.find(id)->camera->shutter;
  frame.seed = job.settings.seed;
  frame.k = image.k;
  frame.camera_from_world_cv = image.camera_from_world_cv;
  if (snapshot.categories) frame.categories = *snapshot.categories;
  return frame;
}

}  // namespace heliograph
