// A scene and its replies, as a snapshot of the journal stores them. Used by the journal and its
// recovery.
#pragma once

#include <memory>
#include <vector>

#include "renderer/scene/restore.h"
#include "server/convert/transaction.h"
#include "server/journal/blob_files.h"
#include "server/journal/record.pb.h"
#include "server/session/request_log.h"
#include "server/store/scene_events.h"

namespace heliograph::server {

/// Kept replies of a session's edits of a scene.
struct LogState {
  u64 session = 0;
  EditLog::State edits;
};
struct SceneState {
  journal::SceneRow row;
  std::shared_ptr<const Snapshot> head;
  std::vector<LogState> logs;
  std::shared_ptr<SceneEvents> events = {};  // the events up to the head
};

/// Stores a state and its arrays and names it in its row. Returns all files that it needs, the
/// state itself last.
[[nodiscard]] Expected<std::vector<BlobFilePtr>> store_state(SceneState& state, BlobFiles& files,
                                                             Room room);
/// Restores a state; fails as rebuild() does. Frees the stored scene's message on the way.
[[nodiscard]] Expected<std::shared_ptr<const Snapshot>> decode_scene(journal::State& state,
                                                                     ArraySource& source,
                                                                     const SceneLimits& limits);
[[nodiscard]] LogState decode_log(const journal::Log& log);

[[nodiscard]] journal::Refusal encode_refusal(const Error& error);
[[nodiscard]] Error decode_refusal(const journal::Refusal& refusal);

}  // namespace heliograph::server
