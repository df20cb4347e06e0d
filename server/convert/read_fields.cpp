// Fields found by name; the arrays of a noun by the descriptor of its message.
#include "server/convert/read_fields.h"

#include <fmt/format.h>

#include <algorithm>

#include "renderer/scene/motion.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"
#include "server/convert/object.h"
#include "server/convert/resolve.h"

namespace heliograph::server {
namespace {

/// Arrays up to this size come within an object; of longer ones only dtype and shape.
constexpr u64 kLargestInline = 64u << 10;

constexpr std::array<std::string_view, 6> kOfEntities{"pose",      "world_pose",  "aabb",
                                                      "materials", "camera.rays", "camera.times"};

struct Noun {
  std::string_view name;
  Kind kind;
};
constexpr std::array<Noun, 5> kNouns{{{"entity", Kind::kEntity},
                                      {"mesh", Kind::kMesh},
                                      {"material", Kind::kMaterial},
                                      {"texture", Kind::kTexture},
                                      {"volume", Kind::kVolume}}};

void object_sink(const BufferPtr& bytes, v1::Array& array) {
  const auto span = bytes->bytes();
  if (span.size() <= kLargestInline) array.set_inline_(span.data(), span.size());
}

/// Returns the names of a noun's arrays, such as "mesh.positions".
void add_arrays(const google::protobuf::Descriptor& message, const char* noun,
                std::vector<std::string>& names) {
  for (int i = 0; i < message.field_count(); ++i)
    if (message.field(i)->message_type() == v1::Array::descriptor())
      names.push_back(fmt::format("{}.{}", noun, message.field(i)->name()));
}

std::unexpected<Error> has_none(const Snapshot& snapshot, Id id, std::string_view name) {
  return fail(
      Code::kInvalidArgument, "",
      fmt::format("the {} has no '{}'; ask an object that has", object_text(id, snapshot), name));
}

/// Returns the object that a noun refers to: the object itself, or the one of that kind that an
/// entity binds; null: it binds none.
Expected<Id> follow(const Snapshot& snapshot, Id id, const Noun& noun) {
  if (id.kind() == noun.kind) return id;
  const Entity* entity = snapshot.find(EntityId(id));
  if (entity && noun.kind == Kind::kMesh) return entity->mesh;
  if (entity && noun.kind == Kind::kVolume) return entity->volume;
  if (entity && noun.kind == Kind::kMaterial)
    return entity->materials && !entity->materials->empty() ? Id(entity->materials->front()) : Id{};
  return has_none(snapshot, id, noun.name);
}

u32 uses_of(const Snapshot& snapshot, Id id) {
  if (const auto* row = snapshot.find(MeshId(id))) return row->uses;
  if (const auto* row = snapshot.find(MaterialId(id))) return row->uses;
  if (const auto* row = snapshot.find(TextureId(id))) return row->uses;
  if (const auto* row = snapshot.find(VolumeId(id))) return row->uses;
  const Entity* entity = snapshot.find(EntityId(id));
  return entity->children + entity->skins;
}

Answer object_answer(const Snapshot& snapshot, Id id) {
  Transaction transaction;
  transaction.edits.push_back(
      {.mode = Mode::kUpdate, .target = id, .action = describe_object(snapshot, id)});
  return {.object = to_proto(transaction, object_sink).edits(0)};
}

Answer dome_answer(const Snapshot& snapshot) {
  Answer answer{.object = v1::Edit()};
  v1::Settings* settings = answer.object->mutable_settings();
  settings->set_time(snapshot.time);
  *settings->mutable_dome() = to_proto(describe_dome(snapshot), object_sink);
  return answer;
}

/// Returns the array that `make` builds with the sink it is given.
template <class Make>
Answer array_answer(const Make& make) {
  Answer answer;
  answer.array = make([&](const BufferPtr& bytes, v1::Array&) { answer.bytes = bytes; });
  return answer;
}

/// Returns one array of the message that `make` builds with the sink it is given.
template <class Make>
std::optional<Answer> field_answer(const std::string& field, const Make& make) {
  std::vector<BufferPtr> buffers;
  const auto message = make([&](const BufferPtr& bytes, v1::Array& array) {
    array.mutable_buffer()->set_buffer(buffers.size());
    buffers.push_back(bytes);
  });
  const auto* descriptor = message.GetDescriptor()->FindFieldByName(field);
  if (!message.GetReflection()->HasField(message, descriptor)) return std::nullopt;
  const auto& array =
      static_cast<const v1::Array&>(message.GetReflection()->GetMessage(message, descriptor));
  return Answer{.array = array, .bytes = buffers[array.buffer().buffer()]};
}

/// An array of a camera's ray table.
std::optional<Answer> ray_table_answer(const Entity& entity, const std::string& field) {
  if (!entity.camera || !entity.camera->rays) return std::nullopt;
  const Camera& camera = *entity.camera;
  return field_answer(field, [&](const ArraySink& sink) {
    return to_proto(*camera.rays, {camera.width, camera.height}, sink);
  });
}

Answer materials_answer(const Entity& entity) {
  std::vector<u64> ids;
  if (entity.materials)
    for (const MaterialId id : *entity.materials) ids.push_back(id.value);
  return array_answer([&](const ArraySink& sink) {
    const u64 count = ids.size();
    return to_array(ArrayOf<u64>(ids).buffer(), v1::D_TYPE_U64, std::span(&count, 1), sink);
  });
}

Answer pose_answer(const mat4x3& pose) {
  return array_answer(
      [&](const ArraySink& sink) { return to_array(std::span(&pose, 1), true, sink); });
}

Answer box_answer(const Box& box) {
  return array_answer([&](const ArraySink& sink) {
    const u64 shape[] = {2, 3};
    const vec3 &a = box.min, &b = box.max;
    return to_array(std::vector<float>{a.x, a.y, a.z, b.x, b.y, b.z}, shape, sink);
  });
}

Answer uses_answer(u32 uses) {
  return array_answer([&](const ArraySink& sink) {
    const u64 one = 1;
    return to_array(ArrayOf<u32>({uses}).buffer(), v1::D_TYPE_U32, std::span(&one, 1), sink);
  });
}

}  // namespace

std::vector<std::string> FieldReader::names() {
  std::vector<std::string> names(kOfEntities.begin(), kOfEntities.end());
  for (const Noun& noun : kNouns) names.emplace_back(noun.name);
  names.insert(names.end(), {"uses", "dome"});
  add_arrays(*v1::Mesh::descriptor(), "mesh", names);
  add_arrays(*v1::Texture::descriptor(), "texture", names);
  return names;
}

Expected<std::optional<Answer>> FieldReader::read(Id id, const std::string& name) {
  if (name == "dome") return dome_answer(snapshot_);
  if (name == "uses") return uses_answer(uses_of(snapshot_, id));
  if (std::ranges::find(kOfEntities, name) != kOfEntities.end()) return read_entity(id, name);
  return read_noun(id, name);
}

Expected<std::optional<Answer>> FieldReader::read_entity(Id id, const std::string& name) {
  const Entity* entity = snapshot_.find(EntityId(id));
  if (!entity) return has_none(snapshot_, id, name);
  const Time time = snapshot_.time;
  if (name == "pose") return pose_answer(local_pose(snapshot_, id.index(), time));
  if (name == "world_pose") return pose_answer(world_pose(snapshot_, id.index(), time));
  if (name == "materials") return materials_answer(*entity);
  if (name.starts_with("camera."))
    return ray_table_answer(*entity, name.substr(name.find('.') + 1));
  if (!boxes_) boxes_.emplace(snapshot_);
  const auto box = boxes_->of(id.index());
  return box ? std::optional(box_answer(*box)) : std::nullopt;
}

Expected<std::optional<Answer>> FieldReader::read_noun(Id id, const std::string& name) {
  const std::size_t dot = name.find('.');
  const Noun& noun = *std::ranges::find(kNouns, name.substr(0, dot), &Noun::name);
  auto object = follow(snapshot_, id, noun);
  if (!object) return std::unexpected(std::move(object).error());
  if (!*object) return std::nullopt;
  if (dot == std::string::npos) return object_answer(snapshot_, *object);
  const Action action = describe_object(snapshot_, *object);
  const std::string field = name.substr(dot + 1);
  const auto make = [&]<class Put>(const Put& put) {
    return field_answer(field, [&](const ArraySink& sink) { return to_proto(put, sink); });
  };
  if (const auto* mesh = std::get_if<PutMesh>(&action)) return make(*mesh);
  return make(std::get<PutTexture>(action));
}

}  // namespace heliograph::server
