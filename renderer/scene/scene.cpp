// The chain of revisions: preparing, publishing, and finding a recent one. Called by the server.
#include "renderer/scene/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

namespace heliograph {

Scene::Scene(std::shared_ptr<const Snapshot> first, SceneLimits limits)
    : limits_(limits), pending_(first), recent_{std::move(first)} {}

Expected<Prepared> Scene::prepare(const Transaction& transaction,
                                  std::optional<Revision> expected) {
  for (;;) {
    std::shared_ptr<const Snapshot> base;
    {
      const std::lock_guard lock(mutex_);
      base = pending_;
    }
    if (expected && *expected != base->revision) {
      Error error{.code = Code::kAborted,
                  .message = fmt::format("the scene is at revision {}, not {}; read and try again",
                                         base->revision, *expected),
                  .where = "expected_revision"};
      error.expected = base->revision;
      return std::unexpected(std::move(error));
    }
    auto prepared = apply(*base, transaction, limits_);
    const std::lock_guard lock(mutex_);
    if (pending_ != base) continue;  // somebody else was faster
    if (prepared) pending_ = prepared->snapshot;
    return prepared;
  }
}

void Scene::publish(const Prepared& prepared) {
  std::deque<std::shared_ptr<const Snapshot>> forgotten;  // freed after the mutex
  const std::lock_guard lock(mutex_);
  assert(prepared.snapshot->revision == recent_.back()->revision + 1);
  recent_.push_back(prepared.snapshot);
  while (recent_.size() > std::max(1u, limits_.revisions)) {
    forgotten.push_back(std::move(recent_.front()));
    recent_.pop_front();
  }
}

void Scene::drop_pending() {
  const std::lock_guard lock(mutex_);
  pending_ = recent_.back();
}

std::shared_ptr<const Snapshot> Scene::head() const {
  const std::lock_guard lock(mutex_);
  return recent_.back();
}

Expected<std::shared_ptr<const Snapshot>> Scene::at(Revision revision) const {
  const std::lock_guard lock(mutex_);
  const Revision oldest = recent_.front()->revision;
  const Revision head = recent_.back()->revision;
  if (revision >= oldest && revision <= head) return recent_[std::size_t(revision - oldest)];
  Error error{
      .code = Code::kOutOfRange,
      .message = fmt::format("revision {} is not kept; there are {} to {}", revision, oldest, head),
      .where = "revision"};
  error.expected = head;
  return std::unexpected(std::move(error));
}

}  // namespace heliograph
