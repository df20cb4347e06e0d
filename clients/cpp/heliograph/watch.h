// The transactions of a scene as they are published. Made by Scene::watch.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/live.h"

namespace heliograph::client {

namespace wire {
class WatchCall;
}

/// Edit of a Change.
struct AppliedEdit {
  std::string action;  // "entity", "mesh", ..., "remove", "instantiate", "poses", "advance", ...
  std::string name{};  // of its target; "": it has none, or was named by its id
  /// Ids of the objects that it put, made, moved or removed; those of large arrays of poses are not
  /// listed.
  std::vector<std::uint64_t> ids{};
  std::vector<std::string> fields{};  // components that it put: "pose", "light"
};

/// Transaction of a scene, by any client.
struct Change {
  std::uint64_t revision = 0;  // that it made
  bool is_bookmark = false;    // no transaction: nothing else happened up to the revision
  std::vector<AppliedEdit> edits{};
};

struct WatchOptions {
  /// The first one wanted, as far back as the daemon keeps them; none: those from now on.
  std::optional<std::uint64_t> from_revision{};
  /// Seconds without a change after which a bookmark comes, [0.5, 3600]; none: none is shown.
  std::optional<double> bookmark_seconds{};
};

/// The changes of a scene: each revision once, in order, none left out, also across lost
/// connections. Throws kOutOfRange when the daemon no longer keeps the next one;
/// details().expected is the oldest that it has. Copies are the same watch; letting go of the last
/// one ends it. Thread: one takes changes, any may close().
class Watch {
 public:
  using iterator = OnePass<Watch, Change>;

  explicit Watch(std::shared_ptr<wire::WatchCall> call) : call_(std::move(call)) {}
  /// Blocks until there is one; none after close().
  std::optional<Change> next();
  iterator begin() { return iterator(this); }
  iterator end() { return {}; }
  /// Last revision whose change was given.
  [[nodiscard]] std::uint64_t revision() const;
  /// Ends it at once.
  void close();

 private:
  std::shared_ptr<wire::WatchCall> call_;
};

}  // namespace heliograph::client
