// Read and ExportScene: streams produced at the reader's pace.
#include "server/calls/rpc.h"
#include "server/calls/service.h"
#include "server/convert/export.h"
#include "server/convert/read.h"

namespace heliograph::server {
namespace {

using SnapshotPtr = std::shared_ptr<const Snapshot>;

struct Asked {
  const Context& context;
  const Session& session;
  u64 scene;
  std::optional<Revision> revision;  // nullopt: the head
};

Expected<SnapshotPtr> find_snapshot(const Daemon& daemon, const Asked& asked) {
  const auto entry = daemon.scenes.find(asked.scene, asked.session);
  if (!entry) return std::unexpected(entry.error());
  auto snapshot = snapshot_at(**entry, asked.revision);
  if (snapshot) daemon.note_revision(asked.context, (*snapshot)->revision);
  return snapshot;
}

}  // namespace

Writer<v1::ReadReply>* Service::Read(Context* context, const v1::ReadRequest* request) {
  const auto prepare = [this, context, request](const std::shared_ptr<Session>& session) {
    return [this, context, request, session, reading = std::make_shared<std::optional<Reading>>()](
               v1::ReadReply& reply) -> Expected<bool> {
      if (!*reading) {
        auto snapshot =
            find_snapshot(daemon_, {*context, *session, request->scene(), std::nullopt});
        if (!snapshot) return std::unexpected(snapshot.error());
        auto made = Reading::create(*request, std::move(*snapshot));
        if (!made) return std::unexpected(made.error());
        reading->emplace(std::move(*made));
      }
      return (*reading)->next(reply);
    };
  };
  return pull<v1::ReadReply>(daemon_, context, *request, prepare);
}

Writer<v1::SceneChunk>* Service::ExportScene(Context* context,
                                             const v1::ExportSceneRequest* request) {
  const auto prepare = [this, context, request](const std::shared_ptr<Session>& session) {
    return [this, context, request, session, file = std::make_shared<std::optional<SceneExport>>()](
               v1::SceneChunk& chunk) -> Expected<bool> {
      if (!*file) {
        const auto revision =
            request->has_revision() ? std::optional(request->revision()) : std::nullopt;
        const auto snapshot =
            find_snapshot(daemon_, {*context, *session, request->scene(), revision});
        if (!snapshot) return std::unexpected(snapshot.error());
        file->emplace(**snapshot);
      }
      return (*file)->next(chunk);
    };
  };
  return pull<v1::SceneChunk>(daemon_, context, *request, prepare);
}

}  // namespace heliograph::server
