#include "renderer/frame/remarks.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <glm/glm.hpp>

#include "renderer/scene/light_shapes.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// Null: it has none that has pixels.
const PlaneData* plane_of(const Frame& frame, Plane plane) {
  const auto found = std::ranges::find(frame.planes, plane, &PlaneData::plane);
  return found == frame.planes.end() || found->pixels.size() == 0 ? nullptr : &*found;
}

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

/// Whether a point lies within a mesh: a ray from it along the mesh's +X meets an odd number of
/// triangles. An edge or a vertex that it meets is met by one of those at it.
bool is_within(const Mesh& mesh, glm::dvec3 point) {
  bool within = false;
  const auto positions = mesh.vertices->positions.span();
  for (const uvec3& triangle : mesh.topology->triangles.span()) {
    glm::dvec3 p[3];
    for (int k = 0; k < 3; ++k) p[k] = glm::dvec3(positions[triangle[k]]) - point;
    // As seen along the ray, z over y.
    bool crosses = false;
    for (int k = 0; k < 3; ++k) {
      const glm::dvec3 &a = p[k], &b = p[(k + 1) % 3];
      if ((a.z > 0) != (b.z > 0) && (a.y - a.z * (b.y - a.y) / (b.z - a.z)) > 0) crosses = !crosses;
    }
    if (!crosses) continue;
    const glm::dvec3 normal = glm::cross(p[1] - p[0], p[2] - p[0]);
    within ^= normal.x != 0 && glm::dot(normal, p[0]) / normal.x > 0;
  }
  return within;
}

/// The name of a visible entity whose mesh a camera stands in; "": there is none.
std::string body_around(const Snapshot& snapshot, double time, const mat4x3& camera) {
  std::string name;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    const Mesh* mesh = shown_mesh(snapshot, entity);
    if (!entity.visible || !mesh || !name.empty()) return;
    const glm::dmat4 object_from_world =
        glm::inverse(glm::dmat4(mat4(world_pose(snapshot, index, time))));
    if (is_within(*mesh, glm::dvec3(object_from_world * glm::dvec4(camera[3], 1))))
      name = snapshot.name_of(snapshot.entity_id(index));
  });
  return name;
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
  if (const std::string body = body_around(snapshot, frame.time, camera); !behind && !body.empty())
    return fmt::format("the camera is inside '{}': move either, or hide it from the camera", body);
  if (!behind) return "";
  return "all of the scene is behind the camera, which looks along its -Z axis; hg.look_at() aims "
         "it";
}

/// How many of the values of a plane, of f32 or f16, are 1.
u64 count_ones(const Pixels& pixels, u64 values) {
  u64 ones = 0;
  const auto count = [&]<class T>(T one) {
    for (u64 i = 0; i < values; ++i) {
      T value;
      std::memcpy(&value, pixels.data() + i * sizeof(T), sizeof(T));
      ones += value == one;
    }
  };
  if (pixels.size() / values == sizeof(float))
    count(std::bit_cast<u32>(1.0f));
  else
    count(u16(0x3c00));
  return ones;
}

/// What a camera's exposure does to its signal; "": nothing to speak of.
std::string about_exposure(const Frame& frame) {
  const PlaneData* signal = plane_of(frame, Plane::SENSOR_RGB);
  if (!signal) return "";
  const u64 values = 3 * u64(frame.width) * frame.height;
  const u64 full = count_ones(signal->pixels, values);
  if (2 * full < values) return "";
  return fmt::format("{} % of sensor_rgb is saturated: lower the exposure of the camera's sensor",
                     100 * full / values);
}

}  // namespace

std::vector<std::string> remarks(const RenderJob& job, const Frame& frame) {
  if (job.on_device) return {};
  std::vector<std::string> out;
  if (std::string exposure = about_exposure(frame); !exposure.empty())
    out.push_back(std::move(exposure));
  const PlaneData* beauty = plane_of(frame, Plane::BEAUTY);
  if (!beauty) return out;
  const Lamps lamps = lamps_of(*job.snapshot);
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
