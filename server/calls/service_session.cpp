// GetServerInfo, ListSessions, OpenSession, KeepSession, CloseSession.
#include <fmt/ranges.h>

#include <algorithm>
#include <optional>
#include <stop_token>
#include <unordered_map>

#include "server/calls/quick_calls.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/config/version.h"
#include "server/convert/frame.h"
#include "server/convert/object.h"
#include "server/convert/page.h"

namespace heliograph::server {
namespace {

void describe_decoder(const Daemon& daemon, v1::GetServerInfoReply& reply) {
  const DecoderState state = daemon.decoder
                                 ? (*daemon.decoder)->state()
                                 : DecoderState{.works = std::unexpected(daemon.decoder.error())};
  reply.add_capabilities(fmt::format("decode_sandbox:{}", fmt::join(state.sandbox, ",")));
  for (const std::string& refused : state.refused) reply.add_refused(refused);
  if (!state.works) reply.add_refused("decoder: " + state.works.error().message);
  reply.set_decoder(state.versions);
}

void describe_sharing(const Daemon& daemon, v1::GetServerInfoReply& reply) {
  if (SealedMemory::create(1))
    reply.add_capabilities("shared_memory");
  else
    reply.add_refused("shared_memory: no sealed memfd; frames travel as bytes");
  if (QuickCalls::are_possible(daemon)) reply.add_capabilities("quick_calls");
  const Engine* engine = daemon.engine->get();
  if (const auto source = engine ? engine->shared_memory() : nullptr)
    reply.add_capabilities(
        fmt::format("device_memory:cuda:{:02x}", fmt::join(*source->device(), "")));
}

void describe_server(const Daemon& daemon, const Tenant& tenant, v1::GetServerInfoReply& reply) {
  reply.set_version(kVersion);
  reply.set_min_api(1);
  reply.set_max_api(1);
  reply.set_instance(daemon.instance);
  reply.set_tenant(tenant.name);
  reply.set_weight(tenant.weight());
  reply.set_backend(daemon.config.backend);
  if (const Engine* engine = daemon.engine->get()) {
    reply.set_cpu_features(engine->cpu_features());
    if (!daemon.tenants.are_several()) reply.set_uploaded_bytes(engine->uploaded_bytes());
  }
  reply.set_threads(daemon.config.threads);
  for (const auto& [name, value] : list_limits(daemon.config.limits))
    (*reply.mutable_limits())[name] = value;
  for (const auto& [name, value] : tenant.limits()) (*reply.mutable_limits())[name] = value;
  for (const auto& [name, amount] : tenant.used()) (*reply.mutable_used())[name] = amount;
  if (daemon.journal) {
    const Status writing = daemon.journal->status();
    reply.set_journal(writing ? v1::GetServerInfoReply::JOURNAL_WRITING
                              : v1::GetServerInfoReply::JOURNAL_READ_ONLY);
    if (!writing) reply.set_journal_reason(writing.error().message);
  } else {
    reply.set_journal(v1::GetServerInfoReply::JOURNAL_NONE);
  }
  reply.set_not_ready(daemon.health.not_ready());
  reply.set_ready(reply.not_ready().empty());
  describe_sharing(daemon, reply);
  if (daemon.config.is_exposed()) reply.add_refused(kExposed);
  describe_decoder(daemon, reply);
  for (u32 i = 0; i < kernels::kPlanes; ++i) *reply.add_planes() = plane_kind(Plane(i));
  *reply.mutable_default_material() = default_material();
}

/// Lists a tenant's sessions, oldest first, without their ids, which are secrets.
Status list_sessions(const Daemon& daemon, const TenantPtr& tenant,
                     const v1::ListSessionsRequest& request, v1::ListSessionsReply& reply) {
  auto page = Page::open(request.page_size(), request.page_token());
  if (!page) return std::unexpected(std::move(page).error());
  auto sessions = daemon.sessions.list();
  std::erase_if(sessions, [&](const auto& session) {
    return session->tenant() != tenant || session->opened() < page->first();
  });
  std::ranges::sort(sessions, {}, [](const auto& session) { return session->opened(); });
  std::unordered_map<u64, u32> scenes;
  for (const ScenePtr& scene : daemon.scenes.all()) ++scenes[scene->owner];
  for (const auto& session : sessions) {
    v1::SessionUse use;
    use.set_client(session->client());
    use.set_open_seconds(session->open_seconds());
    use.set_calls(session->calls());
    use.set_scenes(scenes[session->id()]);
    if (!page->take(session->opened(), use.ByteSizeLong())) break;
    *reply.add_sessions() = std::move(use);
  }
  reply.set_next_page_token(page->next());
  return {};
}

/// The stream that keeps a TCP session alive: open until either side ends it.
class KeepSessionStream final : public Writer<v1::KeepSessionReply> {
 public:
  KeepSessionStream(Sessions& sessions, Call call) : sessions_(sessions), call_(std::move(call)) {
    sessions_.attach(call_.session()->id());
    StartSendInitialMetadata();
    on_end_.emplace(call_.session()->ended(), [this] { finish(); });
  }
  void OnCancel() override { finish(); }
  void OnDone() override {
    on_end_.reset();
    sessions_.detach(call_.session()->id());
    delete this;
  }

 private:
  void finish() {
    if (!is_finished_.exchange(true)) Finish(grpc::Status::OK);
  }
  Sessions& sessions_;
  Call call_;
  std::atomic<bool> is_finished_ = false;
  std::optional<std::stop_callback<std::function<void()>>> on_end_;
};

Expected<std::shared_ptr<Session>> open_session(Daemon& daemon, const TenantPtr& tenant,
                                                const v1::OpenSessionRequest& request) {
  const u64 longest = daemon.config.limits.client_bytes;
  if (request.client().size() > longest)
    return fail(Code::kInvalidArgument, "client",
                fmt::format("has {} bytes; a client's name has at most {} (limit client_bytes)",
                            request.client().size(), longest));
  auto session = daemon.sessions.open({request.client(), tenant, request.resume()});
  if (session && request.resume() != 0) daemon.restore_requests(**session);
  if (!session || request.ticket().empty()) return session;
  const u64 id = (*session)->id();
  daemon.sessions.attach(id);
  if (auto bound = daemon.local_channel->bind(request.ticket(), id); !bound) {
    if (request.resume() != 0)
      daemon.sessions.detach(id);  // the client may resume it with a valid ticket
    else
      daemon.sessions.close(id);
    return std::unexpected(bound.error());
  }
  (*session)->arrays().shared().set_poll(
      [channel = daemon.local_channel.get(), id] { channel->poll(id); });
  return session;
}

}  // namespace

grpc::ServerUnaryReactor* Service::GetServerInfo(Context* context,
                                                 const v1::GetServerInfoRequest* request,
                                                 v1::GetServerInfoReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kNothing, [&](UnaryCall& call) {
    describe_server(daemon_, *call.tenant(), *reply);
    call.finish({});
  });
}

grpc::ServerUnaryReactor* Service::ListSessions(Context* context,
                                                const v1::ListSessionsRequest* request,
                                                v1::ListSessionsReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kNothing, [&](UnaryCall& call) {
    call.finish(list_sessions(daemon_, call.tenant(), *request, *reply));
  });
}

grpc::ServerUnaryReactor* Service::OpenSession(Context* context,
                                               const v1::OpenSessionRequest* request,
                                               v1::OpenSessionReply* reply) {
  return unary(daemon_.gate, context, *request, Needs::kNewSession, [&](UnaryCall& call) {
    const auto session = open_session(daemon_, call.tenant(), *request);
    if (!session) return call.finish(std::unexpected(session.error()));
    if (daemon_.recorder) {
      v1::RecordSession opened;
      opened.set_tenant(call.tenant()->name);
      opened.set_client(request->client());
      opened.set_resumed(request->resume() != 0);
      daemon_.recorder->open_session((*session)->id(), std::move(opened));
    }
    daemon_.log.info("session opened",
                     {{"client", request->client()}, {"tenant", call.tenant()->name}});
    reply->set_session((*session)->id());
    reply->set_instance(daemon_.instance);
    reply->set_grace_seconds(daemon_.config.grace_seconds);
    describe_server(daemon_, *call.tenant(), *reply->mutable_server());
    call.finish({});
  });
}

Writer<v1::KeepSessionReply>* Service::KeepSession(Context* context,
                                                   const v1::KeepSessionRequest* request) {
  using Reactor = Writer<v1::KeepSessionReply>;
  return let_in<Reactor>(
      daemon_.gate, context, *request, Needs::kSessionEvenDraining,
      [&](Call call) { return new KeepSessionStream(daemon_.sessions, std::move(call)); });
}

grpc::ServerUnaryReactor* Service::CloseSession(Context* context,
                                                const v1::CloseSessionRequest* request,
                                                v1::CloseSessionReply*) {
  return unary(daemon_.gate, context, *request, Needs::kSessionEvenDraining, [&](UnaryCall& call) {
    const u64 id = call.session()->id();
    daemon_.sessions.close(id);
    daemon_.local_channel->release(id);
    call.finish({});
  });
}

}  // namespace heliograph::server
