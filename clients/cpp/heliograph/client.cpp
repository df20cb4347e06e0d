// connect(), launch() and the scenes of a client.
#include "heliograph/client.h"

#include <utility>

#include "wire/draft.h"
#include "wire/scene_file.h"
#include "wire/session.h"

namespace heliograph::client {
namespace {

Scene scene_of(const std::shared_ptr<wire::Session>& session, const v1::SceneInfo& info,
               bool owned) {
  return Scene(std::make_shared<wire::SceneCore>(session, info, owned));
}

}  // namespace

Scene Client::create_scene(const std::string& name, Lifetime lifetime) {
  v1::CreateSceneRequest request;
  request.set_request_id(wire::make_request_id());
  request.set_name(name);
  request.set_lifetime(v1::Lifetime(int(lifetime)));
  return scene_of(session_, session_->call(&wire::Session::Stub::CreateScene, request),
                  lifetime == Lifetime::kSession);
}

Scene Client::open_scene(const std::string& name) {
  v1::OpenSceneRequest request;
  request.set_name(name);
  return scene_of(session_, session_->call(&wire::Session::Stub::OpenScene, request), false);
}

Scene Client::load_scene(const std::string& path, const std::string& name, Lifetime lifetime) {
  return scene_of(session_, wire::load_scene(*session_, path, {name, lifetime}),
                  lifetime == Lifetime::kSession);
}

std::vector<Scene> Client::scenes() {
  std::vector<Scene> out;
  v1::ListScenesRequest request;
  do {
    const auto reply = session_->call(&wire::Session::Stub::ListScenes, request);
    for (const v1::SceneInfo& info : reply.scenes()) out.push_back(scene_of(session_, info, false));
    request.set_page_token(reply.next_page_token());
  } while (!request.page_token().empty());
  return out;
}

ServerInfo Client::info() const {
  const auto reply =
      session_->call(&wire::Session::Stub::GetServerInfo, v1::GetServerInfoRequest());
  ServerInfo out;
  out.version = reply.version();
  out.min_api = reply.min_api();
  out.max_api = reply.max_api();
  out.backend = reply.backend();
  out.cpu_features = reply.cpu_features();
  out.threads = reply.threads();
  out.capabilities.assign(reply.capabilities().begin(), reply.capabilities().end());
  out.refused.assign(reply.refused().begin(), reply.refused().end());
  for (const auto& [name, limit] : reply.limits()) out.limits[name] = limit;
  for (const auto& [name, amount] : reply.used()) out.used[name] = amount;
  out.tenant = reply.tenant();
  out.weight = reply.weight();
  out.ready = reply.ready();
  out.journal = Journal(reply.journal());
  out.journal_reason = reply.journal_reason();
  return out;
}

const std::string& Client::address() const { return session_->address(); }

void Client::close() { session_->close(); }

Client connect(const std::string& address, const ConnectOptions& options) {
  return Client(std::make_shared<wire::Session>(address, options, nullptr));
}

Client connect(const std::string& address, const std::string& token) {
  return connect(address, ConnectOptions{token});
}

Client launch(const LaunchOptions& options) {
  const wire::Patience patience(options.timeout);
  auto daemon = std::make_unique<wire::PrivateDaemon>(options);
  const std::string address = daemon->address();
  ConnectOptions connecting;
  connecting.timeout = patience.left();
  connecting.trace = options.trace;
  return Client(std::make_shared<wire::Session>(address, connecting, std::move(daemon)));
}

}  // namespace heliograph::client
