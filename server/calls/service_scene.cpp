// CreateScene, OpenScene, BranchScene, DeleteScene, ListScenes, DescribeScene.
#include <fmt/format.h>

#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/page.h"
#include "server/scene/describe_scene.h"
#include "server/scene/scene_info.h"
#include "server/session/once.h"

namespace heliograph::server {
namespace {

Expected<v1::SceneInfo> create(Daemon& daemon, const Session& session, NewScene scene) {
  auto entry = daemon.scenes.create(std::move(scene), session);
  if (!entry) return std::unexpected(entry.error());
  return scene_info(daemon.scenes, **entry, session);
}

/// Runs a task that may change durable scenes, and so wait for the disk, on the pool.
void run(Daemon& daemon, UnaryCall& call, WorkPool::Task task) {
  if (daemon.journal) return call.post(daemon.pool, std::move(task));
  task();
}

Expected<v1::SceneInfo> create_scene(Daemon& daemon, const Session& session,
                                     const v1::CreateSceneRequest& request) {
  return create(daemon, session,
                {.name = request.name(),
                 .lifetime = request.lifetime(),
                 .first = std::make_shared<const Snapshot>(),
                 .request_id = request.request_id(),
                 .method = "CreateScene"});
}

Expected<v1::SceneInfo> branch_scene(Daemon& daemon, const Session& session,
                                     const v1::BranchSceneRequest& request) {
  auto parent = daemon.scenes.find(request.scene(), session);
  if (!parent) return std::unexpected(parent.error());
  auto snapshot = snapshot_at(
      **parent, request.has_revision() ? std::optional(request.revision()) : std::nullopt);
  if (!snapshot) return std::unexpected(std::move(snapshot).error().at("revision"));
  return create(daemon, session,
                {.name = request.name(),
                 .lifetime = request.lifetime(),
                 .first = std::move(*snapshot),
                 .request_id = request.request_id(),
                 .method = "BranchScene"});
}

Expected<v1::DeleteSceneReply> delete_scene(Daemon& daemon, const Session& session,
                                            const v1::DeleteSceneRequest& request) {
  HELIO_TRY(daemon.scenes.remove(request.scene(), session));
  return v1::DeleteSceneReply();
}

Status list_scenes(Daemon& daemon, const Session& session, const v1::ListScenesRequest& request,
                   v1::ListScenesReply& reply) {
  auto page = Page::open(request.page_size(), request.page_token());
  if (!page) return std::unexpected(std::move(page).error());
  for (const ScenePtr& scene : daemon.scenes.list(session)) {
    if (scene->number < page->first()) continue;
    v1::SceneInfo info = scene_info(daemon.scenes, *scene, session);
    if (!page->take(scene->number, info.ByteSizeLong())) break;
    *reply.add_scenes() = std::move(info);
  }
  reply.set_next_page_token(page->next());
  return {};
}

Status describe_scene(Daemon& daemon, const UnaryCall& call,
                      const v1::DescribeSceneRequest& request, v1::DescribeSceneReply& reply) {
  const Session& session = *call.session();
  const auto entry = daemon.scenes.find(request.scene(), session);
  if (!entry) return std::unexpected(entry.error());
  const auto snapshot = (*entry)->scene.head();
  daemon.note_revision(call.context(), snapshot->revision);
  v1::SceneInfo& info = *reply.mutable_scene();
  info = scene_info(daemon.scenes, **entry, session);
  info.set_revision(snapshot->revision);  // the whole reply describes one revision
  info.set_time(snapshot->time);
  describe_counts(*snapshot, *reply.mutable_counts());
  if (request.page_token().empty()) describe_categories(*snapshot, reply);
  if (request.pattern().size() > kMostNameBytes)
    return fail(Code::kInvalidArgument, "pattern",
                fmt::format("has {} bytes; names, and patterns of them, have at most {}",
                            request.pattern().size(), kMostNameBytes));
  auto page = Page::open(request.page_size(), request.page_token());
  if (!page) return std::unexpected(std::move(page).error());
  if (request.tree()) describe_objects(*snapshot, request.pattern(), *page, reply);
  if (!request.memory()) return {};
  auto& memory = *reply.mutable_memory();
  memory.set_arrays(array_bytes(*snapshot));
  memory.set_rows(row_bytes(*snapshot));
  const Engine* engine = daemon.engine->get();
  if (engine != nullptr && !daemon.tenants.are_several())  // the figure includes all tenants
    memory.set_derived(engine->derived_bytes());
  return {};
}

}  // namespace

grpc::ServerUnaryReactor* Service::CreateScene(Context* context,
                                               const v1::CreateSceneRequest* request,
                                               v1::SceneInfo* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    run(daemon_, call, [this, &call, request, reply] {
      const OnceKey key{call.session()->requests(), request->request_id(), "CreateScene"};
      const Status made =
          once(key, *reply, [&] { return create_scene(daemon_, *call.session(), *request); });
      if (made) bring_up_to_date(daemon_.scenes, *call.session(), *reply);
      call.finish(made);
    });
  });
}

grpc::ServerUnaryReactor* Service::OpenScene(Context* context, const v1::OpenSceneRequest* request,
                                             v1::SceneInfo* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    const Session& session = *call.session();
    const auto entry = daemon_.scenes.open(request->name(), session);
    if (!entry) return call.finish(std::unexpected(entry.error()));
    *reply = scene_info(daemon_.scenes, **entry, session);
    call.finish({});
  });
}

grpc::ServerUnaryReactor* Service::BranchScene(Context* context,
                                               const v1::BranchSceneRequest* request,
                                               v1::SceneInfo* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    run(daemon_, call, [this, &call, request, reply] {
      const OnceKey key{call.session()->requests(), request->request_id(), "BranchScene"};
      const Status made =
          once(key, *reply, [&] { return branch_scene(daemon_, *call.session(), *request); });
      if (made) bring_up_to_date(daemon_.scenes, *call.session(), *reply);
      call.finish(made);
    });
  });
}

grpc::ServerUnaryReactor* Service::DeleteScene(Context* context,
                                               const v1::DeleteSceneRequest* request,
                                               v1::DeleteSceneReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    run(daemon_, call, [this, &call, request, reply] {
      const OnceKey key{call.session()->requests(), request->request_id(), "DeleteScene"};
      call.finish(
          once(key, *reply, [&] { return delete_scene(daemon_, *call.session(), *request); }));
    });
  });
}

grpc::ServerUnaryReactor* Service::ListScenes(Context* context,
                                              const v1::ListScenesRequest* request,
                                              v1::ListScenesReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    call.finish(list_scenes(daemon_, *call.session(), *request, *reply));
  });
}

grpc::ServerUnaryReactor* Service::DescribeScene(Context* context,
                                                 const v1::DescribeSceneRequest* request,
                                                 v1::DescribeSceneReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kSession, [&](UnaryCall& call) {
    call.post(daemon_.pool, [this, request, reply, &call] {
      call.finish(describe_scene(daemon_, call, *request, *reply));
    });
  });
}

}  // namespace heliograph::server
