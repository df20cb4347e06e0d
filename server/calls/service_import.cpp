// ImportScene: a scene file in chunks becomes a new scene.
#include "server/calls/call_scope.h"
#include "server/calls/monitored_reader.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/export.h"
#include "server/scene/scene_import.h"
#include "server/scene/scene_info.h"
#include "server/session/once.h"

namespace heliograph::server {
namespace {

class ImportCall final : public MonitoredReader<v1::SceneChunk> {
 public:
  ImportCall(Daemon& daemon, grpc::CallbackServerContext& context, Call call, v1::SceneInfo& reply)
      : MonitoredReader(daemon, context),
        daemon_(daemon),
        call_(std::move(call)),
        reply_(reply),
        file_(std::in_place, call_.session()->arrays(),
              Charge::none(call_.tenant()->ledger.bytes)) {}

 private:
  void came(bool ok) override {
    if (!ok) return end();
    Status taken = check_known(message());
    if (taken) taken = file_->append(message());
    if (!taken) return finish(taken);
    read();
  }
  void let_go() override { file_.reset(); }

  void end() {
    if (context().IsCancelled())
      return finish(fail(Code::kCancelled, "", "the import was cancelled"));
    if (auto known = daemon_.gate.check(Credentials(context()), call_.tenant()); !known)
      return finish(known);
    const auto posted = daemon_.pool.post(call_.tenant()->id, [this] { finish(build()); });
    if (!posted) finish(posted);
  }
  Status build() {
    const auto scene = file_->finish();
    if (!scene) return std::unexpected(scene.error());
    const OnceKey key{call_.session()->requests(), scene->request_id, "ImportScene"};
    HELIO_TRY(once(key, reply_, [&] { return create(*scene); }));
    bring_up_to_date(daemon_.scenes, *call_.session(), reply_);
    return {};
  }
  Expected<v1::SceneInfo> create(const ImportedScene& scene) {
    auto made = rebuild(scene.description, daemon_.scenes.scene_limits());
    if (!made) return std::unexpected(std::move(made).error().at("header"));
    const Session& session = *call_.session();
    auto entry = daemon_.scenes.create({.name = scene.name,
                                        .lifetime = scene.lifetime,
                                        .first = *std::move(made),
                                        .request_id = scene.request_id,
                                        .method = "ImportScene"},
                                       session);
    if (!entry) return std::unexpected(entry.error());
    return scene_info(daemon_.scenes, **entry, session);
  }
  Daemon& daemon_;
  Call call_;
  v1::SceneInfo& reply_;
  std::optional<SceneImport> file_;
};

}  // namespace

Reader<v1::SceneChunk>* Service::ImportScene(Context* context, v1::SceneInfo* reply) {
  using Reactor = Reader<v1::SceneChunk>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call call) {
    return ImportCall::start(
        std::make_shared<ImportCall>(daemon_, *context, std::move(call), *reply), daemon_);
  });
}

}  // namespace heliograph::server
