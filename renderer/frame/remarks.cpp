#include "renderer/frame/remarks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <glm/glm.hpp>
#include <ranges>

#include "kernels/camera/projection.h"
#include "renderer/base/half.h"
#include "renderer/scene/light_shapes.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// Null: it has none that has pixels.
const PlaneData* plane_of(const Frame& frame, Plane plane) {
  const auto found = std::ranges::find(frame.planes, plane, &PlaneData::plane);
  return found == frame.planes.end() || found->pixels.size() == 0 ? nullptr : &*found;
}

/// True if a picture of f32 or f16 is black all over. channels: 3, or 4 with an alpha
bool is_black(const Pixels& pixels, u64 count, u64 channels) {
  const std::size_t channel = pixels.size() / (channels * count);
  for (u64 i = 0; i < count; ++i) {
    const std::span color(pixels.data() + i * channels * channel, 3 * channel);
    if (std::ranges::any_of(color, [](std::byte b) { return b != std::byte{0}; })) return false;
  }
  return true;
}

/// The first entity of some and how many others there are.
std::string named(const Snapshot& snapshot, std::span<const u32> entities) {
  const std::string& first = snapshot.name_of(snapshot.entity_id(entities.front()));
  if (entities.size() == 1) return fmt::format("'{}'", first);
  return fmt::format("'{}' (and {} more)", first, entities.size() - 1);
}

/// Lights with a strength that shine nowhere; "": there are none.
std::string about_idle(const Snapshot& snapshot, std::span<const u32> idle) {
  std::vector<u32> strong;
  for (const u32 entity : idle)
    if (emits(*snapshot.entities.at(entity).light)) strong.push_back(entity);
  if (strong.empty()) return "";
  return fmt::format(
      "light {} has neither a mesh nor a shape and shines nowhere: "
      "give it shape=\"sphere\", or its entity a mesh",
      named(snapshot, strong));
}

/// Reason why nothing in a scene gives off light.
///
/// idle   lights that have remarks of their own, ascending
std::string why_dark(const Snapshot& snapshot, std::span<const u32> idle) {
  std::vector<u32> weak, hidden;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (!entity.light || std::ranges::binary_search(idle, index)) return;
    (emits(*entity.light) ? hidden : weak).push_back(index);
  });
  if (!hidden.empty())
    return fmt::format("light {} is not visible or has no area; show it, or add a dome",
                       named(snapshot, hidden));
  if (!weak.empty())
    return fmt::format("light {} has a strength or a colour of 0; give it power, or add a dome",
                       named(snapshot, weak));
  if (snapshot.dome)
    return "the dome has no colour, or an intensity of 0, and there is no other light; set both";
  return "the scene has no light; add a dome, a sun or a light";
}

constexpr const char* kBehind =
    "all of the scene is behind the camera, which looks along its -Z axis; hg.look_at() aims it";

/// True if a mesh is behind a camera as far as some hundreds of its vertices show.
bool is_behind(const Mesh& mesh, const mat4x3& world, const mat4x3& camera) {
  constexpr std::size_t kLooked = 256;
  const auto positions = mesh.vertices->positions.span();
  const std::size_t step = std::max<std::size_t>(positions.size() / kLooked, 1);
  for (std::size_t i = 0; i < positions.size(); i += step)
    if (glm::dot(world * vec4(positions[i], 1) - camera[3], camera[2]) <= 0) return false;
  return true;
}

/// True if a point lies within a mesh: a ray from it along the mesh's +X meets an odd number of
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

/// Reason why a camera cannot see anything; "": it may.
std::string why_empty(const RenderJob& job, const Frame& frame) {
  const Snapshot& snapshot = *job.snapshot;
  const EntityId id = job.cameras[frame.index];
  const Projection projection = snapshot.find(id)->camera->projection;
  const mat4x3 camera = world_pose(snapshot, id.index(), frame.time);
  bool any = false;
  bool behind = kernels::is_straight(projection);
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
  return kBehind;
}

/// Part of a box that a camera whose image is flat sees: range of depths, and size in pixels.
struct Extent {
  double nearest = INFINITY, farthest = -INFINITY;
  glm::dvec2 lower{INFINITY}, upper{-INFINITY};
};
Extent extent_of(const resident::Box& box, const Frame& frame, bool perspective) {
  Extent extent;
  for (int corner = 0; corner < 8; ++corner) {
    const auto side = [&](int axis) {
      return double((corner >> axis & 1 ? box.upper : box.lower)[axis]);
    };
    const glm::dvec3 p = frame.camera_from_world_cv * glm::dvec4(side(0), side(1), side(2), 1);
    extent.nearest = std::min(extent.nearest, p.z);
    extent.farthest = std::max(extent.farthest, p.z);
    const glm::dvec2 at = glm::dvec2(frame.k[0][0] * p.x, frame.k[1][1] * p.y);
    extent.lower = glm::min(extent.lower, perspective ? at / p.z : at);
    extent.upper = glm::max(extent.upper, perspective ? at / p.z : at);
  }
  return extent;
}

/// Reason why a picture shows nothing of a scene that fills a box; "": it may.
std::string why_out_of_sight(const Camera& camera, const resident::Box& box, const Frame& frame) {
  if (box.empty() || !kernels::is_straight(camera.projection)) return "";
  const Extent extent = extent_of(box, frame, !kernels::is_parallel(camera.projection));
  if (extent.farthest <= 0) return kBehind;
  if (extent.farthest < camera.near)
    return fmt::format("all of the scene is nearer than the camera's near of {} m", camera.near);
  if (camera.far > 0 && extent.nearest > camera.far)
    return fmt::format("all of the scene is farther than the camera's far of {} m", camera.far);
  const glm::dvec2 size = extent.upper - extent.lower;
  if (extent.nearest > 0 && std::max(size.x, size.y) < 1)
    return "all of the scene is smaller than a pixel: is it in metres, and the camera near it?";
  return "";
}

/// The values of a plane of f32 or f16.
auto values_of(const Pixels& pixels, u64 count) {
  const bool is_half = pixels.size() / count == sizeof(u16);
  return std::views::iota(u64(0), count) | std::views::transform([&pixels, is_half](u64 i) {
           u16 half;
           float value;
           if (!is_half) {
             std::memcpy(&value, pixels.data() + i * sizeof value, sizeof value);
             return value;
           }
           std::memcpy(&half, pixels.data() + i * sizeof half, sizeof half);
           return float_of_half(half);
         });
}

/// Effect of a camera's exposure on its signal; "": none worth a remark.
std::string about_exposure(const Camera& camera, const Frame& frame) {
  const PlaneData* signal = plane_of(frame, Plane::SENSOR_RGB);
  if (!signal) return "";
  const u64 count = 3 * u64(frame.width) * frame.height;
  const auto values = values_of(signal->pixels, count);
  const auto full = u64(std::ranges::count(values, 1.0f));
  if (2 * full >= count)
    return fmt::format("{} % of sensor_rgb is saturated: lower the exposure of the camera's sensor",
                       100 * full / count);
  // Noise about black is no picture.
  const auto black = float(camera.rgb_sensor->black_level);
  const float dark = black + (1 - black) / 256;
  if (std::ranges::any_of(values, [&](float value) { return value > dark; })) return "";
  return "sensor_rgb is black: raise the exposure of the camera's sensor, or light the scene";
}

/// Light groups whose planes are black, of a picture that is not; "": there are none.
std::string about_groups(const RenderJob& job, const Frame& frame) {
  const auto group = [](const PlaneData& plane) { return plane.plane == Plane::BEAUTY_GROUP; };
  const u64 count = u64(frame.width) * frame.height;
  std::vector<std::string> dark;
  std::size_t next = 0;
  for (const PlaneData& plane : frame.planes | std::views::filter(group)) {
    const std::string& name = job.groups[next++];
    if (plane.pixels.size() > 0 && is_black(plane.pixels, count, 3))
      dark.push_back(fmt::format("'{}'", name));
  }
  if (dark.empty()) return "";
  return fmt::format(
      "light group {} is black: none of its light reaches what the camera sees; "
      "set light_group on a light that does",
      fmt::join(dark, ", "));
}

/// Things that a picture shows nothing of, and why; "": it shows something.
std::string about_sight(const RenderJob& job, const SceneSummary& scene, const Frame& frame) {
  const PlaneData* beauty = plane_of(frame, Plane::BEAUTY);
  const EntityId camera = job.cameras[frame.index];
  std::string why = why_out_of_sight(*job.snapshot->find(camera)->camera, scene.bounds, frame);
  if (!beauty || !is_black(beauty->pixels, u64(frame.width) * frame.height, 4))
    return why.empty() ? "" : "nothing of the scene is in sight: " + why;
  if (!scene.lit) why = why_dark(*job.snapshot, scene.idle);
  if (why.empty()) why = why_empty(job, frame);
  if (why.empty())
    why =
        "no light reaches what the camera sees, if it sees anything: something may be in the way, "
        "or max_depth or the number of samples too small";
  return "the picture is black: " + why;
}

}  // namespace

std::vector<std::string> remarks(const RenderJob& job, const SceneSummary& scene,
                                 const Frame& frame) {
  if (job.on_device) return {};
  const Camera& camera = *job.snapshot->find(job.cameras[frame.index])->camera;
  std::vector<std::string> out = {about_exposure(camera, frame)};
  if (plane_of(frame, Plane::BEAUTY)) out.push_back(about_idle(*job.snapshot, scene.idle));
  out.push_back(about_sight(job, scene, frame));
  if (out.back().empty()) out.push_back(about_groups(job, frame));
  std::erase(out, "");
  return out;
}

}  // namespace heliograph
