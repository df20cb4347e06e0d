// A daemon without its sockets: edits of durable scenes, and its state directory as a crash leaves
// it. For the tests of the journal.
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <random>

#include "server/calls/daemon.h"
#include "server/calls/edit_calls.h"
#include "server/convert/export.h"
#include "server/os/hash.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

namespace heliograph::server {

/// A folder of its own, removed at the end. `fast`: in memory, where the machine has that.
class Folder {
 public:
  explicit Folder(bool fast = true) {
    static std::atomic<int> last = 0;
    const bool has_memory = fast && std::filesystem::exists("/dev/shm");
    path_ = std::filesystem::path(has_memory ? "/dev/shm" : "/var/tmp") /
            fmt::format("heliograph-test-{}-{}", ::getpid(), ++last);
    std::filesystem::create_directory(path_);
    std::filesystem::permissions(path_, std::filesystem::perms::owner_all);
  }
  Folder(const Folder&) = delete;
  ~Folder() { std::filesystem::remove_all(path_); }
  [[nodiscard]] std::string path() const { return path_.string(); }
  [[nodiscard]] std::string operator/(const std::string& name) const {
    return (path_ / name).string();
  }
  /// What is in `other`, as a crash at this moment leaves it. Retries while files come and go.
  void copy(const std::string& other) const {
    std::filesystem::remove_all(path_);
    std::filesystem::copy(other, path_, std::filesystem::copy_options::recursive);
  }

 private:
  std::filesystem::path path_;
};

inline Config state_config(const std::string& folder, u64 snapshot_edits) {
  Config config;
  config.state_dir = folder;
  config.log_level = "off";
  config.limits.snapshot_edits = snapshot_edits;
  config.limits.snapshot_bytes = snapshot_edits << 20;
  config.limits.scenes = 100'000;
  return config;
}

class Server {
 public:
  explicit Server(const std::string& folder, u64 snapshot_edits = 100'000)
      : Server(state_config(folder, snapshot_edits)) {}
  explicit Server(const Config& config)
      : daemon(config, Identities(), EventLoop::create().value()),
        opened(daemon.open_journal()),
        tenant(daemon.tenants.named("tester")) {}

  [[nodiscard]] std::shared_ptr<Session> session(u64 resume = 0) {
    return daemon.sessions.open({.client = "test", .tenant = tenant, .resume = resume}).value();
  }
  [[nodiscard]] ScenePtr create(const Session& by, const std::string& name, v1::Lifetime lifetime) {
    auto made = daemon.scenes.create(
        {.name = name, .lifetime = lifetime, .first = std::make_shared<const Snapshot>()}, by);
    INFO((made ? "" : made.error().message));
    REQUIRE(made);
    return *made;
  }

  Daemon daemon;
  Status opened;
  TenantPtr tenant;
};

/// The reply to an edit, waited for.
inline EditLog::Reply apply(Server& server, const std::shared_ptr<Session>& session,
                            const v1::ApplyRequest& request) {
  std::promise<EditLog::Reply> promise;
  apply_numbered(server.daemon, session, request,
                 [&](const EditLog::Reply& reply) { promise.set_value(reply); });
  return promise.get_future().get();
}

/// One entity put at x.
inline v1::ApplyRequest placed(u64 scene, u64 number, const std::string& name, float x) {
  v1::ApplyRequest request;
  request.set_scene(scene);
  request.set_number(number);
  v1::Edit* edit = request.mutable_transaction()->add_edits();
  edit->mutable_target()->set_name(name);
  *edit->mutable_entity()->mutable_pose()->mutable_matrices() = f32({4, 4}, translations({x}));
  return request;
}

/// Everything that a scene is: equal texts render and go on alike.
inline std::string fingerprint(const Snapshot& snapshot) {
  v1::SceneChunk::Header header = scene_header(snapshot, inline_sink);
  std::string text = serialize(header);
  const SceneNumbers n = numbers(snapshot);
  text += fmt::format("{} {} {};", n.revision, n.advances, n.next_label);
  for (const TableIds* ids : {&n.entities, &n.meshes, &n.materials, &n.textures, &n.volumes})
    for (const auto* list : {&ids->versions, &ids->order})
      for (const u32 number : *list) text += fmt::format("{} ", number);
  return sha256(text);
}

}  // namespace heliograph::server
