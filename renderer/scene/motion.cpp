// Interpolation of keys, parents, skins and vertices, and what flow needs. Declared in motion.h.
#include "renderer/scene/motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <span>

#include "renderer/scene/parents_first.h"

namespace heliograph {

namespace {

/// Place of `time` among increasing times: between [index] and [index + 1], at fraction u.
struct Between {
  std::size_t index = 0;
  float u = 0;
};

Between locate(const std::vector<Time>& times, Time time) {
  const auto after = std::ranges::upper_bound(times, time);
  if (after == times.begin()) return {};
  const std::size_t i = std::size_t(after - times.begin()) - 1;
  if (after == times.end()) return {.index = i};
  return {.index = i, .u = float((time - times[i]) / (times[i + 1] - times[i]))};
}

mat4x3 pose_at(const PoseKeys& keys, Time time) {
  const auto after = std::ranges::upper_bound(keys, time, {}, &PoseKey::time);
  if (after == keys.begin()) return after->matrix;
  const PoseKey& from = *std::prev(after);
  if (after == keys.end()) return from.matrix;
  return interpolate(from.matrix, after->matrix,
                     float((time - from.time) / (after->time - from.time)));
}

float history_fraction(const Snapshot& snapshot, Time time) {
  const double from = snapshot.previous->time;
  return float(std::clamp((time - from) / (snapshot.time - from), 0.0, 1.0));
}

/// Its local pose before the last Advance, relative to its present parent.
mat4x3 local_before(const Snapshot& snapshot, u32 entity, const Entity& then) {
  const Snapshot& previous = *snapshot.previous;
  const EntityId parent = snapshot.entities.at(entity).parent;
  if (then.parent == parent) return local_pose(previous, entity, previous.time);
  const mat4x3 world = world_pose(previous, entity, previous.time);
  if (!parent) return world;
  return multiply(inverse(world_pose(snapshot, parent.index(), previous.time)), world);
}

bool has_keys_above(const Snapshot& snapshot, EntityId id) {
  for (const Entity* e = snapshot.find(id); e; e = snapshot.find(e->parent))
    if (e->keys) return true;
  return false;
}

/// True if something states where this entity is at other times.
bool is_keyed(const Snapshot& snapshot, u32 index) {
  const Entity& entity = snapshot.entities.at(index);
  if (has_keys_above(snapshot, snapshot.entity_id(index))) return true;
  if (entity.morph_weights && entity.morph_weights->times.size() > 1) return true;
  if (const auto* mesh = snapshot.find(entity.mesh);
      mesh && mesh->value->vertices->times.size() > 1)
    return true;
  return entity.skin && std::ranges::any_of(entity.skin->joints, [&](EntityId joint) {
           return has_keys_above(snapshot, joint);
         });
}

// ---------------------------------------------------------------- vertices

/// positions or normals of keys at a time.
class Keyed {
 public:
  Keyed(const VertexKeys& keys, const ArrayOf<vec3>& values, Time time)
      : count_(values.size() / keys.times.size()) {
    const auto [i, u] = locate(keys.times, time);
    first_ = values.data() + i * count_;
    u_ = u;
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] vec3 operator[](std::size_t v) const {
    return u_ > 0 ? glm::mix(first_[v], first_[count_ + v], u_) : first_[v];
  }

 private:
  std::size_t count_;
  const vec3* first_;
  float u_;
};

bool same(const std::shared_ptr<const Skin>& a, const std::shared_ptr<const Skin>& b) {
  return a == b || (a && b && a->joints == b->joints && a->inverse_binds == b->inverse_binds);
}

/// Morph weights at a time; those without keys move from what they were before the last Advance.
std::vector<float> weights_at(const Snapshot& snapshot, u32 index, u32 morph_count, Time time) {
  const Entity& now = snapshot.entities.at(index);
  std::vector<float> weights = morph_weights(now, morph_count, time);
  const bool keyed = now.morph_weights && !now.morph_weights->times.empty();
  if (!in_history(snapshot, time) || keyed || !mesh_before_advance(snapshot, index)) return weights;
  const Entity& then = *before_advance(snapshot, index);
  if (then.morph_weights == now.morph_weights) return weights;
  std::vector<float> old = morph_weights(then, morph_count, snapshot.previous->time);
  old.resize(morph_count);
  weights.resize(morph_count);
  const float u = history_fraction(snapshot, time);
  for (u32 m = 0; m < morph_count; ++m) weights[m] = std::lerp(old[m], weights[m], u);
  return weights;
}

/// Vertices from `begin` on, before their skin.
struct Part {
  std::size_t begin;
  std::span<vec3> values;
};
void set(const Part& part, const Keyed& keyed) {
  for (std::size_t v = 0; v < part.values.size(); ++v) part.values[v] = keyed[part.begin + v];
}
void blend(const Part& part, const Keyed& other, float u) {
  for (std::size_t v = 0; v < part.values.size(); ++v)
    part.values[v] = glm::mix(other[part.begin + v], part.values[v], u);
}
void add_morphs(const Part& part, const ArrayOf<vec3>& targets, const std::vector<float>& weights) {
  if (targets.empty() || weights.empty()) return;
  const std::size_t count = targets.size() / weights.size();
  for (std::size_t m = 0; m < weights.size(); ++m) {
    if (weights[m] == 0) continue;
    const vec3* target = targets.data() + m * count + part.begin;
    for (std::size_t v = 0; v < part.values.size(); ++v) part.values[v] += target[v] * weights[m];
  }
}

mat4x3 scaled(const mat4x3& m, float s) { return {m[0] * s, m[1] * s, m[2] * s, m[3] * s}; }
mat4x3 plus(const mat4x3& a, const mat4x3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]};
}

/// The joints' poses relative to the entity's.
std::vector<mat4x3> joints_of(const Skin& skin, const mat4x3& entity_world,
                              const std::vector<mat4x3>& world_poses) {
  const mat4x3 entity_from_world = inverse(entity_world);
  std::vector<mat4x3> joints;
  for (std::size_t j = 0; j < skin.joints.size(); ++j)
    joints.push_back(multiply(multiply(entity_from_world, world_poses[skin.joints[j].index()]),
                              skin.inverse_binds[j]));
  return joints;
}

/// Linear blend skinning (glTF 2.0, section 3.7.3.3). normals   may be empty
void apply_skin(std::span<const mat4x3> joints, const MeshTopology& topology, const Part& positions,
                std::span<vec3> normals) {
  for (std::size_t i = 0; i < positions.values.size(); ++i) {
    const std::size_t v = positions.begin + i;
    mat4x3 blended(0);
    for (int k = 0; k < 4; ++k)
      if (const float w = topology.weights[v][k]; w != 0)
        blended = plus(blended, scaled(joints[topology.joints[v][k]], w));
    positions.values[i] = blended * vec4(positions.values[i], 1);
    if (normals.empty()) continue;
    const vec3 n = glm::transpose(glm::inverse(mat3(blended))) * normals[i];
    const float length = glm::length(n);
    if (length > 0 && std::isfinite(length)) normals[i] = n / length;
  }
}

}  // namespace

// ---------------------------------------------------------------- before the last Advance

const Entity* before_advance(const Snapshot& snapshot, u32 entity) {
  if (!snapshot.previous || snapshot.entities.at(entity).teleported == snapshot.advances)
    return nullptr;
  return snapshot.previous->find(snapshot.entity_id(entity));
}

const Mesh* mesh_before_advance(const Snapshot& snapshot, u32 entity) {
  const Entity& now = snapshot.entities.at(entity);
  const Entity* then = before_advance(snapshot, entity);
  const auto* mesh = snapshot.find(now.mesh);
  if (!then || !mesh || then->mesh != now.mesh || !same(then->skin, now.skin)) return nullptr;
  const auto* old = snapshot.previous->find(then->mesh);
  return old && old->value->topology == mesh->value->topology ? old->value.get() : nullptr;
}

// ---------------------------------------------------------------- poses

mat4x3 local_pose(const Snapshot& snapshot, u32 entity, Time time) {
  if (snapshot.keyed > 0)
    if (const auto& keys = snapshot.entities.at(entity).keys) return pose_at(*keys, time);
  const mat4x3& now = snapshot.poses[entity];
  if (!in_history(snapshot, time)) return now;
  const Entity* then = before_advance(snapshot, entity);
  if (!then) return now;
  return interpolate(local_before(snapshot, entity, *then), now, history_fraction(snapshot, time));
}

mat4x3 world_pose(const Snapshot& snapshot, u32 entity, Time time) {
  mat4x3 world = local_pose(snapshot, entity, time);
  for (EntityId parent = snapshot.entities.at(entity).parent; parent;
       parent = snapshot.entities.at(parent.index()).parent)
    world = multiply(local_pose(snapshot, parent.index(), time), world);
  return world;
}

std::vector<mat4x3> world_poses(const Snapshot& snapshot, Time time) {
  std::vector<mat4x3> world(snapshot.entities.capacity(), mat4x3(1));
  for_each_parents_first(snapshot, [&](u32 index, const Entity& entity) {
    const mat4x3 local = local_pose(snapshot, index, time);
    world[index] = entity.parent ? multiply(world[entity.parent.index()], local) : local;
  });
  return world;
}

bool visible(const Snapshot& snapshot, u32 entity) {
  for (const Entity* e = &snapshot.entities.at(entity); e; e = snapshot.find(e->parent))
    if (!e->visible) return false;
  return true;
}

// ---------------------------------------------------------------- deformation

std::vector<float> morph_weights(const Entity& entity, u32 morph_count, Time time) {
  if (!entity.morph_weights || morph_count == 0) return {};
  const MorphWeights& keys = *entity.morph_weights;
  const std::span<const float> all = keys.weights;
  if (keys.times.empty()) return {all.begin(), all.begin() + morph_count};
  const auto [i, u] = locate(keys.times, time);
  const auto a = all.subspan(i * morph_count, morph_count);
  std::vector<float> out(a.begin(), a.end());
  if (u > 0)
    for (u32 m = 0; m < morph_count; ++m)
      out[m] = std::lerp(a[m], all[(i + 1) * morph_count + m], u);
  return out;
}

std::optional<DeformedVertices> deform(const Snapshot& snapshot, u32 entity, Time time,
                                       const DeformContext& context) {
  const Entity& e = snapshot.entities.at(entity);
  const auto* shared = snapshot.find(e.mesh);
  if (!shared) return std::nullopt;
  const VertexKeys& keys = *shared->value->vertices;
  const MeshTopology& topology = *shared->value->topology;
  const std::vector<float> weights = weights_at(snapshot, entity, topology.morph_count, time);
  const bool morphs = std::ranges::any_of(weights, [](float w) { return w != 0; });
  const bool keyed = keys.times.size() > 1;
  const Mesh* old =
      in_history(snapshot, time) && !keyed ? mesh_before_advance(snapshot, entity) : nullptr;
  if (old && old->vertices == shared->value->vertices) old = nullptr;
  if (!keyed && !old && !morphs && !e.skin) return std::nullopt;

  const auto set_part = [&](const Part& part, ArrayOf<vec3> VertexKeys::* values,
                            const ArrayOf<vec3>& targets) {
    const Keyed now(keys, keys.*values, time);
    set(part, now);
    if (old) {
      const Keyed then(*old->vertices, (*old->vertices).*values, snapshot.previous->time);
      // Normals came or went: the present ones serve.
      if (then.count() == now.count()) blend(part, then, history_fraction(snapshot, time));
    }
    add_morphs(part, targets, weights);
  };
  std::vector<mat4x3> joints;
  if (e.skin) joints = joints_of(*e.skin, context.world_poses[entity], context.world_poses);
  DeformedVertices out;
  out.positions.resize(keys.positions.size() / keys.times.size());
  out.normals.resize(keys.normals.size() / keys.times.size());
  context.in_pieces(out.positions.size(), [&](std::size_t begin, std::size_t end) {
    const Part positions{begin, std::span(out.positions).subspan(begin, end - begin)};
    set_part(positions, &VertexKeys::positions, topology.morph_positions);
    std::span<vec3> normals;
    if (!out.normals.empty()) normals = std::span(out.normals).subspan(begin, end - begin);
    set_part({begin, normals}, &VertexKeys::normals, topology.morph_normals);
    for (vec3& n : normals)
      if (const float length = glm::length(n); length > 0) n /= length;
    if (e.skin) apply_skin(joints, topology, positions, normals);
  });
  return out;
}

// ---------------------------------------------------------------- flow

namespace {

/// Times this near are the same, for sums like t - dt are rounded.
double tolerance(const Snapshot& snapshot) { return 1e-9 * std::max(1.0, std::abs(snapshot.time)); }

/// True if the entity and its ancestors were there before the last Advance and did not jump since.
bool all_were_there(const Snapshot& snapshot, EntityId id) {
  for (; id; id = snapshot.entities.at(id.index()).parent)
    if (!before_advance(snapshot, id.index())) return false;
  return true;
}

}  // namespace

Status flow_defined(const Snapshot& snapshot, Time time, Time other,
                    const std::vector<EntityId>& cameras) {
  const auto [from, to] = std::minmax(time, other);
  if (snapshot.previous && from >= snapshot.previous->time - tolerance(snapshot) &&
      to <= snapshot.time + tolerance(snapshot))
    return {};
  const auto refuse = [&](u32 index) {
    const std::string name = snapshot.name_of(snapshot.entity_id(index));
    return fail(
        Code::kFailedPrecondition, "planes",
        fmt::format("flow from {:g} s to {:g} s is not defined: '{}' has no keys there. Give it "
                    "keys=, call edit.advance(dt) before moving things, or pass hold=True to "
                    "say that what has no keys stands still",
                    time, other, name.empty() ? "an entity without a name" : name));
  };
  for (const EntityId camera : cameras)
    if (!is_keyed(snapshot, camera.index())) return refuse(camera.index());
  for (u32 i = 0; i < snapshot.entities.capacity(); ++i)
    if (snapshot.entities.alive(i) &&
        (snapshot.entities.at(i).mesh || snapshot.entities.at(i).volume) && visible(snapshot, i) &&
        !is_keyed(snapshot, i))
      return refuse(i);
  return {};
}

bool flow_valid(const Snapshot& snapshot, u32 entity, Time time, Time other) {
  if (!in_history(snapshot, std::min(time, other) + tolerance(snapshot))) return true;
  const Entity& now = snapshot.entities.at(entity);
  if (now.mesh && !mesh_before_advance(snapshot, entity)) return false;
  if (!all_were_there(snapshot, snapshot.entity_id(entity))) return false;
  return !now.skin || std::ranges::all_of(now.skin->joints, [&](EntityId joint) {
    return all_were_there(snapshot, joint);
  });
}

}  // namespace heliograph
