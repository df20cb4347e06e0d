#include "renderer/frame/remarks.h"

#include <fmt/format.h>

#include <algorithm>
#include <glm/glm.hpp>

#include "renderer/scene/light_shapes.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// Whether a beauty, of f32 or f16, is black all over.
bool is_black(const Pixels& pixels, u64 count) {
  const std::size_t channel = pixels.size() / (4 * count);
  for (u64 i = 0; i < count; ++i) {
    const std::span color(pixels.data() + i * 4 * channel, 3 * channel);
    if (std::ranges::any_of(color, [](std::byte b) { return b != std::byte{0}; })) return false;
  }
  return true;
}

bool is_black(vec3 color) { return !(color.x > 0 || color.y > 0 || color.z > 0); }

struct Lamps {
  bool any = false;
  u32 idle = 0;            // with neither a mesh nor a shape
  std::string first_idle;  // its name
};
Lamps lamps_of(const Snapshot& snapshot) {
  Lamps lamps;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (!entity.light || is_black(entity.light->color) || !(entity.light->intensity > 0)) return;
    if (entity.light->sun_angle > 0 || shown_mesh(snapshot, entity)) {
      lamps.any = true;
    } else if (lamps.idle++ == 0) {
      lamps.first_idle = snapshot.name_of(snapshot.entity_id(index));
    }
  });
  if (const Dome* dome = snapshot.dome.get())
    lamps.any |=
        dome->intensity > 0 && !is_black(dome->color.value_or(vec3(dome->texture ? 1 : 0)));
  snapshot.materials.for_each([&](u32, const Shared<Material>& row) {
    lamps.any |= !is_black((*row.value)[MaterialParameter::emission].value);
  });
  return lamps;
}

/// Whether a mesh is behind a camera as far as some hundreds of its vertices tell.
bool is_behind(const Mesh& mesh, const mat4x3& world, const mat4x3& camera) {
  constexpr std::size_t kLooked = 256;
  const auto positions = mesh.vertices->positions.span();
  const std::size_t step = std::max<std::size_t>(positions.size() / kLooked, 1);
  for (std::size_t i = 0; i < positions.size(); i += step)
    if (glm::dot(world * vec4(positions[i], 1) - camera[3], camera[2]) <= 0) return false;
  return true;
}

/// Why a camera cannot see anything; "": it may.
std::string why_empty(const RenderJob& job, const Frame& frame) {
  const Snapshot& snapshot = *job.snapshot;
  const EntityId id = job.cameras[frame.index];
  const Projection projection = snapshot.find(id)->camera->projection;
  const mat4x3 camera = world_pose(snapshot, id.index(), frame.time);
  bool any = false;
  bool behind = projection == Projection::kPerspective || projection == Projection::kOrthographic;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    const Mesh* mesh = shown_mesh(snapshot, entity);
    if (!entity.visible || (!mesh && !entity.volume)) return;
    any = true;
    behind = behind && mesh && is_behind(*mesh, world_pose(snapshot, index, frame.time), camera);
  });
  if (!any) return "nothing in the scene has a mesh and is visible";
  if (!behind) return "";
  return "all of the scene is behind the camera, which looks along its -Z axis; hg.look_at() aims "
         "it";
}

}  // namespace

std::vector<std::string> remarks(const RenderJob& job, const Frame& frame) {
  const auto beauty = std::ranges::find(frame.planes, Plane::BEAUTY, &PlaneData::plane);
  if (beauty == frame.planes.end() || job.on_device || beauty->pixels.size() == 0) return {};
  const Lamps lamps = lamps_of(*job.snapshot);
  std::vector<std::string> out;
  if (lamps.idle > 0)
    out.push_back(fmt::format(
        "light '{}'{} has neither a mesh nor a shape and shines nowhere: "
        "give it shape=\"sphere\", or its entity a mesh",
        lamps.first_idle, lamps.idle > 1 ? fmt::format(" (and {} more)", lamps.idle - 1) : ""));
  if (!is_black(beauty->pixels, u64(frame.width) * frame.height)) return out;
  std::string why = why_empty(job, frame);
  if (!lamps.any) why = "the scene has no light; add a dome, a sun or a light";
  if (why.empty())
    why =
        "no light reaches what the camera sees, if it sees anything: something may be in the way, "
        "or max_depth or the number of samples too small";
  out.push_back("the picture is black: " + why);
  return out;
}

}  // namespace heliograph
