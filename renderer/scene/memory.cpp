// Weight of the arrays of a scene. Called by apply() and by DescribeScene.
#include <fmt/format.h>

#include <unordered_set>

#include "renderer/scene/draft.h"
#include "renderer/scene/ray_table.h"

namespace heliograph {
namespace {

template <class F>
void for_each_array(const Mesh& mesh, F&& f) {
  for (const BufferPtr& buffer : mesh.topology->buffers())
    if (buffer) f(*buffer);
  for (const BufferPtr& buffer :
       {mesh.vertices->positions.buffer(), mesh.vertices->normals.buffer()})
    if (buffer) f(*buffer);
}
template <class F>
void for_each_array(const Texture& texture, F&& f) {
  if (texture.image->texels) f(*texture.image->texels);
}
template <class F>
void for_each_array(const Volume& volume, F&& f) {
  for (const auto& grid : {volume.density, volume.temperature, volume.color}) {
    if (!grid) continue;
    for (const BufferPtr& buffer : {grid->bricks.buffer(), grid->values.buffer()})
      if (buffer) f(*buffer);
  }
}

template <class F>
void for_each_array(const Entity& entity, F&& f) {
  if (!entity.camera || !entity.camera->rays) return;
  const RayTable& table = *entity.camera->rays;
  for (const BufferPtr& buffer : {table.rays.buffer(), table.times.buffer()})
    if (buffer) f(*buffer);
}

template <class T>
u64 sum_of_arrays(const T& value) {
  u64 bytes = 0;
  for_each_array(value, [&](const Buffer& buffer) { bytes += buffer.bytes().size(); });
  return bytes;
}

struct Sum {
  std::unordered_set<u64> serials;
  u64 bytes = 0;

  template <class T>
  void add_arrays(const T& value) {
    for_each_array(value, [&](const Buffer& buffer) {
      if (serials.insert(buffer.serial()).second) bytes += buffer.bytes().size();
    });
  }
  template <class T>
  void add(const Table<Shared<T>>& table) {
    table.for_each([&](u32, const Shared<T>& row) { add_arrays(*row.value); });
  }
  void add(const Snapshot& snapshot) {
    snapshot.entities.for_each([&](u32, const Entity& entity) { add_arrays(entity); });
    add(snapshot.meshes);
    add(snapshot.textures);
    add(snapshot.volumes);
  }
};

}  // namespace

u64 bytes_of(const Mesh& mesh) { return sum_of_arrays(mesh); }
u64 bytes_of(const Texture& texture) { return sum_of_arrays(texture); }
u64 bytes_of(const Volume& volume) { return sum_of_arrays(volume); }
u64 bytes_of(const Entity& entity) { return sum_of_arrays(entity); }

u64 array_bytes(const Snapshot& snapshot) {
  Sum sum;
  sum.add(snapshot);
  if (snapshot.previous) sum.add(*snapshot.previous);
  return sum.bytes;
}

Status check_memory(const Draft& draft) {
  const Snapshot& scene = draft.next;
  const u64 bound = scene.array_bound + (scene.previous ? scene.previous->array_bound : 0);
  if (bound <= draft.limits.array_bytes) return {};
  const u64 bytes = array_bytes(scene);
  if (bytes <= draft.limits.array_bytes) return {};
  return std::unexpected(
      Error{.code = Code::kResourceExhausted,
            .message = fmt::format("the scene's arrays would take {} bytes; {} are allowed", bytes,
                                   draft.limits.array_bytes),
            .where = "edits",
            .limit = "array_bytes",
            .needed = bytes,
            .available = draft.limits.array_bytes});
}

}  // namespace heliograph
