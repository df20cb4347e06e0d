// State behind public objects: scenes, objects, transactions, assets.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/edit.h"
#include "heliograph/error.h"
#include "heliograph/ref.h"
#include "heliograph/v1/service.pb.h"

namespace heliograph::client::wire {

class Session;

/// A scene; deletes it at its end if it is the client's own.
struct SceneCore {
  std::shared_ptr<Session> session;
  std::uint64_t id = 0;
  std::string name;
  std::atomic<bool> owned{false};

  SceneCore(std::shared_ptr<Session> of, const v1::SceneInfo& info, bool is_owned);
  ~SceneCore();
  SceneCore(const SceneCore&) = delete;
  SceneCore& operator=(const SceneCore&) = delete;

  /// DescribeScene; `fill` sets what else is asked for.
  template <class Fill>
  v1::DescribeSceneReply describe(Fill fill) const {
    v1::DescribeSceneRequest request;
    request.set_scene(id);
    fill(request);
    return ask(request);
  }
  [[nodiscard]] v1::DescribeSceneReply ask(const v1::DescribeSceneRequest& request) const;
  /// Lists objects whose names match a glob, by kind and in id order.
  [[nodiscard]] std::vector<v1::ObjectInfo> objects(const std::string& pattern) const;
  /// The id of a name; kNotFound lists the nearest.
  [[nodiscard]] std::uint64_t resolve(const std::string& object) const;
  void remove();
};

constexpr std::int64_t kByName = -1;  // Node::edit of what only its name denotes in its transaction

/// Object of a scene. `id` is 0 until its transaction is committed, or its name was resolved.
struct Node {
  std::shared_ptr<SceneCore> scene;
  Kind kind = Kind::kEntity;
  std::string name;
  std::atomic<std::uint64_t> id{0};
  std::weak_ptr<const Draft> draft{};  // the transaction that makes it; none: it exists
  bool is_made = false;                // by `draft`
  std::int64_t edit = 0;               // its index there, or kByName
};

std::shared_ptr<Node> make_node(std::shared_ptr<SceneCore> scene, Kind kind, std::string name,
                                std::uint64_t id = 0);

/// Receivers of the ids of an edit's reply. Weak: all may be gone.
struct IdTarget {
  struct To {
    Kind kind;
    std::weak_ptr<Node> node;
  };
  int edit = 0;
  bool is_further = false;  // the further ids, each to the next node of its kind; else the one id
  std::vector<To> nodes{};
};

struct Draft {
  std::shared_ptr<SceneCore> scene;
  bool publish = true;
  std::optional<std::uint64_t> expected_revision{};
  v1::Transaction transaction{};
  std::vector<IdTarget> targets{};
  std::vector<std::string> warnings{};  // about files of pictures
  bool open = true;
};

/// The Ref of a handle or a name, within a transaction or outside of any.
void put_ref(const Ref& ref, const Draft* within, const std::string& field, v1::Ref* out);

struct AssetState {
  std::shared_ptr<SceneCore> scene;
  std::string name;
  v1::AssetInfo info;
  std::vector<std::string> materials{};
  std::vector<std::string> animations{};
  std::vector<std::string> warnings{};
  std::vector<std::shared_ptr<Node>> meshes{}, material_nodes{}, textures{};  // in the file's order
  std::vector<Group> placed{};  // one a placement: the root, then the rest in the file's order
};

/// A transaction that was handed to a lane.
struct PendingEdit {
  v1::ApplyRequest request{};
  std::vector<IdTarget> targets{};
  bool is_done = false;
  std::uint64_t revision = 0;
  std::optional<ClientError> error{};
};

}  // namespace heliograph::client::wire
