// Edits, renders, reads and life of a scene; its queries are in query.cpp.
#include "heliograph/scene.h"

#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "wire/arrays.h"
#include "wire/convert.h"
#include "wire/frame_receiver.h"
#include "wire/live.h"
#include "wire/read.h"
#include "wire/scene_file.h"
#include "wire/session.h"
#include "wire/watch.h"

namespace heliograph::client {
namespace {

template <class T>
T typed(const std::shared_ptr<wire::SceneCore>& core, const std::string& name) {
  const std::uint64_t id = core->resolve(name);
  if (Kind(id >> 56) != T::kKind)
    throw ClientError(Code::kInvalidArgument,
                      "name: \"" + name + "\" is of another kind; find() tells which", {"name"});
  return T(wire::make_node(core, T::kKind, name, id));
}

std::vector<Ref> refs_of(const Group& entities) { return {entities.begin(), entities.end()}; }

v1::RenderRequest request_of(const std::string& manifest) {
  using google::protobuf::util::JsonStringToMessage;
  google::protobuf::Struct fields;
  v1::RenderRequest out;
  const auto found = JsonStringToMessage(manifest, &fields).ok() ? fields.fields().find("request")
                                                                 : fields.fields().end();
  std::string json;
  if (found == fields.fields().end() ||
      !google::protobuf::util::MessageToJsonString(found->second, &json).ok() ||
      !JsonStringToMessage(json, &out).ok())
    throw ClientError(Code::kInvalidArgument,
                      "manifest: is none of a frame; give FrameInfo::manifest as it is",
                      {"manifest"});
  const auto overlay = fields.fields().find("overlay");
  const bool had_overlay =
      overlay != fields.fields().end() &&
      (overlay->second.number_value() != 0 || !overlay->second.string_value().empty());
  if (had_overlay && !out.has_overlay())
    throw ClientError(Code::kInvalidArgument,
                      "manifest: its frame had an overlay too large to be kept; apply the same "
                      "edits to the scene and render as usual",
                      {"manifest"});
  return out;
}

}  // namespace

std::uint64_t Scene::id() const { return core_->id; }
const std::string& Scene::name() const { return core_->name; }

Transaction Scene::edit(std::optional<std::uint64_t> expected_revision) const {
  auto draft = std::make_shared<wire::Draft>();
  draft->scene = core_;
  draft->expected_revision = expected_revision;
  return Transaction(std::move(draft));
}

Overlay Scene::overlay() const {
  auto draft = std::make_shared<wire::Draft>();
  draft->scene = core_;
  draft->publish = false;
  return Overlay(std::move(draft));
}

// ---------------------------------------------------------------- rendering

Frame Scene::render(const Ref& camera, const RenderOptions& options) const {
  return render(std::vector<Ref>{camera}, options).front();
}

std::vector<Frame> Scene::render(const std::vector<Ref>& cameras,
                                 const RenderOptions& options) const {
  const v1::RenderRequest request =
      wire::to_request(core_->session->server(), core_->id, cameras, options);
  return wire::render(core_->session, request, options.fields());
}

Results Scene::render_batch(Jobs jobs, const BatchOptions& options) const {
  return Results(std::make_shared<wire::BatchCall>(core_, std::move(jobs), options));
}

Results Scene::render_batch(std::vector<Job> jobs, const BatchOptions& options) const {
  const auto listed = std::make_shared<const std::vector<Job>>(std::move(jobs));
  return render_batch(
      [listed, next = std::size_t(0)]() mutable -> std::optional<Job> {
        if (next == listed->size()) return std::nullopt;
        return (*listed)[next++];
      },
      options);
}

Live Scene::stream(const std::vector<Ref>& cameras, const RenderOptions& options, Policy policy,
                   std::uint32_t credits) const {
  return Live(std::make_shared<wire::LiveCall>(core_, cameras, options, policy, credits));
}

Watch Scene::watch(const WatchOptions& options) const {
  return Watch(std::make_shared<wire::WatchCall>(core_, options));
}

Frame Scene::rerender(const std::string& manifest) const {
  v1::RenderRequest request = request_of(manifest);
  request.set_scene(core_->id);
  request.clear_at();
  return wire::render(core_->session, request, {}).front();
}

// ---------------------------------------------------------------- reading

std::uint64_t Scene::revision() const {
  return core_->describe([](auto&) {}).scene().revision();
}
Lifetime Scene::lifetime() const {
  return Lifetime(core_->describe([](auto&) {}).scene().lifetime());
}
double Scene::time() const {
  return core_->describe([](auto&) {}).scene().time();
}

std::map<std::uint32_t, std::string> Scene::categories() const {
  std::map<std::uint32_t, std::string> out;
  const auto reply = core_->describe([](auto&) {});
  for (const v1::Category& category : reply.categories()) out[category.id()] = category.name();
  return out;
}

std::map<std::string, std::uint64_t> Scene::counts() const {
  const v1::ObjectCounts counts = core_->describe([](auto&) {}).counts();
  return {{"entities", counts.entities()},
          {"meshes", counts.meshes()},
          {"materials", counts.materials()},
          {"textures", counts.textures()},
          {"volumes", counts.volumes()}};
}

std::map<std::string, std::uint64_t> Scene::memory() const {
  const v1::SceneMemory memory =
      core_->describe([](auto& request) { request.set_memory(true); }).memory();
  std::map<std::string, std::uint64_t> out{{"rows", memory.rows()}, {"arrays", memory.arrays()}};
  if (memory.has_derived()) out["derived"] = memory.derived();
  return out;
}

Entity Scene::entity(const std::string& name) const { return typed<Entity>(core_, name); }
Mesh Scene::mesh(const std::string& name) const { return typed<Mesh>(core_, name); }
Material Scene::material(const std::string& name) const { return typed<Material>(core_, name); }
Texture Scene::texture(const std::string& name) const { return typed<Texture>(core_, name); }
Volume Scene::volume(const std::string& name) const { return typed<Volume>(core_, name); }

std::vector<Handle> Scene::find(const std::string& pattern) const {
  std::vector<Handle> out;
  for (const v1::ObjectInfo& object : core_->objects(pattern))
    out.emplace_back(wire::make_node(core_, Kind(object.id() >> 56), object.name(), object.id()));
  return out;
}

bool Scene::contains(const std::string& name) const {
  try {
    return core_->resolve(name) != 0;
  } catch (const ClientError& error) {
    if (error.code() != Code::kNotFound) throw;
    return false;
  }
}

std::vector<Array> Scene::read(const std::vector<Ref>& things, const std::string& field) const {
  std::vector<Array> out;
  for (wire::Found& found : wire::read(*core_, things, field))
    out.push_back(found.array ? std::move(*found.array) : Array());
  return out;
}

Array Scene::transforms(const Group& entities) const {
  std::vector<Mat4f> out;
  out.reserve(entities.size());
  if (!entities.empty())
    for (const Array& pose : read(refs_of(entities), "pose"))
      out.push_back(wire::matrix_of<Mat4f>(pose));
  return Array(std::move(out));
}

// ---------------------------------------------------------------- life

Scene Scene::branch(const std::string& name, std::optional<std::uint64_t> revision,
                    Lifetime lifetime) const {
  v1::BranchSceneRequest request;
  request.set_request_id(wire::make_request_id());
  request.set_scene(core_->id);
  request.set_name(name);
  request.set_lifetime(v1::Lifetime(int(lifetime)));
  if (revision) request.set_revision(*revision);
  const auto info = core_->session->call(&wire::Session::Stub::BranchScene, request);
  return Scene(
      std::make_shared<wire::SceneCore>(core_->session, info, lifetime == Lifetime::kSession));
}

void Scene::save(const std::string& path, std::optional<std::uint64_t> revision) const {
  wire::save_scene(*core_, path, revision);
}

void Scene::remove() { core_->remove(); }

}  // namespace heliograph::client
