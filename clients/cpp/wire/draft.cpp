// Scenes, objects and references inside.
#include "wire/draft.h"

#include "wire/apply_lane.h"
#include "wire/session.h"

namespace heliograph::client::wire {

SceneCore::SceneCore(std::shared_ptr<Session> of, const v1::SceneInfo& info, bool is_owned)
    : session(std::move(of)), id(info.scene()), name(info.name()), owned(is_owned) {
  session->lane_of(id).expect(id, info.next_edit());
}

SceneCore::~SceneCore() {
  if (!owned || session->is_closed()) return;
  try {
    remove();
  } catch (const ClientError&) {
    // The end of the session frees it too.
  }
}

v1::DescribeSceneReply SceneCore::ask(const v1::DescribeSceneRequest& request) const {
  return session->call(&Session::Stub::DescribeScene, request);
}

std::vector<v1::ObjectInfo> SceneCore::objects(const std::string& pattern) const {
  std::vector<v1::ObjectInfo> out;
  std::string token;
  do {
    const auto reply = describe([&](auto& request) {
      request.set_tree(true);
      request.set_pattern(pattern);
      request.set_page_token(token);
    });
    out.insert(out.end(), reply.objects().begin(), reply.objects().end());
    token = reply.next_page_token();
  } while (!token.empty());
  return out;
}

std::uint64_t SceneCore::resolve(const std::string& object) const {
  std::string pattern;
  for (const char c : object)
    pattern += c == '*' || c == '?' || c == '[' ? std::string("[") + c + "]" : std::string(1, c);
  for (const v1::ObjectInfo& info : objects(pattern))
    if (info.name() == object) return info.id();
  v1::ReadRequest request;  // a Read of a name that is not there lists the nearest
  request.set_scene(id);
  request.add_refs()->set_name(object);
  request.add_fields("uses");
  grpc::ClientContext context;
  session->prepare(context);
  const auto reader = session->stub().Read(&context, request);
  for (v1::ReadReply reply; reader->Read(&reply);) {
  }
  session->check(reader->Finish());
  throw ClientError(Code::kNotFound, "name: no object called \"" + object + "\"; find() lists all",
                    {"name"});
}

void SceneCore::remove() {
  owned = false;
  v1::DeleteSceneRequest request;
  request.set_request_id(make_request_id());
  request.set_scene(id);
  session->call(&Session::Stub::DeleteScene, request);
  session->lane_of(id).forget(id);
}

std::shared_ptr<Node> make_node(std::shared_ptr<SceneCore> scene, Kind kind, std::string name,
                                std::uint64_t id) {
  auto node = std::make_shared<Node>();
  node->scene = std::move(scene);
  node->kind = kind;
  node->name = std::move(name);
  node->id = id;
  return node;
}

void put_ref(const Ref& ref, const Draft* within, const std::string& field, v1::Ref* out) {
  const auto& node = ref.handle().node();
  if (node == nullptr) {
    if (ref.name().empty())
      throw ClientError(Code::kInvalidArgument,
                        field + ": refers to nothing; give a handle or a name", {field});
    return out->set_name(ref.name());
  }
  if (const std::uint64_t id = node->id) return out->set_id(id);
  if (!node->is_made) return out->set_name(node->name);
  if (within != nullptr && node->draft.lock().get() == within) {
    if (node->edit == kByName) return out->set_name(node->name);
    return out->set_created_by_edit(std::uint32_t(node->edit));
  }
  throw ClientError(Code::kFailedPrecondition,
                    field + ": \"" + node->name + "\" does not exist yet; commit its transaction",
                    {field});
}

}  // namespace heliograph::client::wire
