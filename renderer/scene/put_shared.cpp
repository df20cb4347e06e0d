// Putting meshes, materials, textures and volumes. Called by apply().
#include <fmt/format.h>

#include <algorithm>

#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

/// Makes `value` the content of the target's row in `table`, which is created when it is new.
template <class T>
Id store(Draft& draft, Table<Shared<T>>& table, const Target& target,
         std::shared_ptr<const T> value) {
  draft.next.array_bound += bytes_of(*value);
  if (target.id) {
    Shared<T>& row = table.write(target.id.index());
    draft.next.array_bound -= bytes_of(*row.value);
    row.value = std::move(value);
    return target.id;
  }
  Shared<T> row{.name = nullptr, .value = std::move(value), .uses = 0};
  if (!target.name.empty()) row.name = std::make_shared<const std::string>(target.name);
  const u32 index = table.insert(std::move(row));
  const Id id = Id::make(kKindOf<T>, table.version(index), index);
  if (!target.name.empty()) draft.next.names.set(target.name, id);
  return id;
}

template <class T>
const T* present(const Table<Shared<T>>& table, const Target& target) {
  return target.id ? table.at(target.id.index()).value.get() : nullptr;
}

Status check_vertices(const MeshTopology& topology, const VertexKeys& vertices) {
  const std::size_t keys = vertices.times.size();
  const std::size_t needed = keys * topology.vertex_count;
  if (vertices.positions.size() != needed)
    return fail(Code::kInvalidArgument, "positions",
                fmt::format("{} positions; the topology has {} vertices at {} times",
                            vertices.positions.size(), topology.vertex_count, keys));
  if (!vertices.normals.empty() && !topology.curves.empty())
    return fail(Code::kInvalidArgument, "normals",
                "is of triangles, curves have their own; leave it out");
  if (!vertices.normals.empty() && vertices.normals.size() != needed)
    return fail(Code::kInvalidArgument, "normals",
                fmt::format("{} normals for {} positions", vertices.normals.size(), needed));
  return {};
}

/// A new topology has to fit the lights, skins and morph weights of every entity that shows the
/// mesh.
Status check_users(const Snapshot& scene, MeshId mesh, const MeshTopology& topology) {
  Status status;
  scene.entities.for_each([&](u32 index, const Entity& entity) {
    if (!status || entity.mesh != mesh) return;
    auto fits = check_light(entity, topology);
    if (fits && (entity.skin || entity.morph_weights)) fits = check_deformation(entity, topology);
    if (fits) return;
    Error error = std::move(fits).error();
    error.where = "";
    error.message =
        describe_object(scene, scene.entity_id(index)) + " shows this mesh: " + error.message;
    status = std::unexpected(std::move(error));
  });
  return status;
}

constexpr std::string_view kParameterNames[] = {
#define HELIO_NAME(name, ...) #name,
    HELIO_MATERIAL_PARAMETERS(HELIO_NAME)
#undef HELIO_NAME
};

}  // namespace

Expected<Id> put(Draft& draft, const Scope&, const Target& target, const PutMesh& patch) {
  const Mesh* before = present(draft.next.meshes, target);
  Mesh mesh = before ? *before : Mesh{};
  if (patch.topology) mesh.topology = patch.topology;
  if (patch.vertices) mesh.vertices = patch.vertices;
  mesh.reshaped = !patch.topology && (mesh.reshaped || patch.vertices);
  if (!mesh.topology)
    return fail(Code::kInvalidArgument, "indices",
                "a new mesh needs triangles, or curves and radii");
  if (!mesh.vertices)
    return fail(Code::kInvalidArgument, "positions", "a new mesh needs positions");
  if (mesh.vertices->times.empty())
    return fail(Code::kInvalidArgument, "times", "vertices are at one time at least");
  HELIO_TRY(check_vertices(*mesh.topology, *mesh.vertices));
  const bool shown = before && draft.next.meshes.at(target.id.index()).uses > 0;
  if (shown && patch.topology)
    HELIO_TRY(check_users(draft.next, MeshId(target.id), *patch.topology));
  return store(draft, draft.next.meshes, target, std::make_shared<const Mesh>(std::move(mesh)));
}

Expected<Id> put(Draft& draft, const Scope& scope, const Target& target, const PutMaterial& patch) {
  const Material* present_value = present(draft.next.materials, target);
  const Material before = present_value ? *present_value : make_material();
  Material material = before;
  for (std::size_t p = 0; p < kMaterialParameters; ++p) {
    const ParameterPatch& change = patch.parameters[p];
    if (change.value) material.parameters[p].value = *change.value;
    if (change.texture) {
      auto status = bind(scope, *change.texture, "texture", material.parameters[p].texture);
      if (!status)
        return std::unexpected(std::move(status).error().at(std::string(kParameterNames[p])));
    }
  }
#define HELIO_MAP(name) \
  if (patch.name) HELIO_TRY(bind(scope, *patch.name, #name, material.name));
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  if (patch.alpha_mode) material.alpha_mode = *patch.alpha_mode;
  if (patch.alpha_cutoff) material.alpha_cutoff = *patch.alpha_cutoff;
  if (patch.two_sided_emission) material.two_sided_emission = *patch.two_sided_emission;
  if (patch.unlit) material.unlit = *patch.unlit;
  if (patch.thin_walled) material.thin_walled = *patch.thin_walled;
  if (patch.priority) material.priority = *patch.priority;
  count(draft, before, material);
  return store(draft, draft.next.materials, target, std::make_shared<const Material>(material));
}

Expected<Id> put(Draft& draft, const Scope&, const Target& target, const PutTexture& patch) {
  const Texture* before = present(draft.next.textures, target);
  Texture texture = before ? *before : Texture{};
  if (patch.image) texture.image = patch.image;
  if (!texture.image) return fail(Code::kInvalidArgument, "texels", "a new texture needs texels");
  if (!before) texture.srgb = texture.image->type == TexelType::kU8;
  if (patch.srgb) texture.srgb = *patch.srgb;
  if (patch.nearest) texture.nearest = *patch.nearest;
  if (patch.wrap_u) texture.wrap_u = *patch.wrap_u;
  if (patch.wrap_v) texture.wrap_v = *patch.wrap_v;
  return store(draft, draft.next.textures, target, std::make_shared<const Texture>(texture));
}

Expected<Id> put(Draft& draft, const Scope&, const Target& target, const PutVolume& patch) {
  const Volume* before = present(draft.next.volumes, target);
  Volume volume = before ? *before : Volume{};
  if (patch.density) volume.density = patch.density;
  if (!volume.density) return fail(Code::kInvalidArgument, "density", "a new volume needs density");
  if (patch.temperature) volume.temperature = *patch.temperature;
  if (patch.color) volume.color = *patch.color;
  if (patch.density_scale) volume.density_scale = *patch.density_scale;
  if (patch.albedo) volume.albedo = *patch.albedo;
  if (patch.anisotropy) volume.anisotropy = *patch.anisotropy;
  if (patch.temperature_scale) volume.temperature_scale = *patch.temperature_scale;
  if (patch.emission_scale) volume.emission_scale = *patch.emission_scale;
  return store(draft, draft.next.volumes, target, std::make_shared<const Volume>(volume));
}

}  // namespace heliograph
