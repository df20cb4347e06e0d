// The chain of revisions: preparing, publishing, and finding a recent one. Called by the server.
#include "renderer/scene/scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>

namespace heliograph {

Scene::Scene(const std::shared_ptr<const Snapshot>& first, SceneLimits limits) : limits_(limits) {
  auto own = std::make_shared<Snapshot>(*first);
  own->scene = life_;
  recent_.push_back(std::move(own));
}

const std::shared_ptr<const Snapshot>& Scene::last() const {
  return pending_.empty() ? recent_.back() : pending_.back();
}

Expected<Prepared> Scene::prepare(const Transaction& transaction,
                                  std::optional<Revision> expected) {
  for (;;) {
    const std::shared_ptr<const Snapshot> base = pending();
    if (expected && *expected != base->revision) {
      Error error{.code = Code::kAborted,
                  .message = fmt::format("the scene is at revision {}, not {}; read and try again",
                                         base->revision, *expected),
                  .where = "expected_revision"};
      error.reason = "STALE_REVISION";
      error.expected = base->revision;
      return std::unexpected(std::move(error));
    }
    auto prepared = apply(*base, transaction, limits_);
    const std::lock_guard lock(mutex_);
    if (last() != base) continue;  // somebody else was faster
    if (prepared) pending_.push_back(prepared->snapshot);
    return prepared;
  }
}

std::vector<std::shared_ptr<const Snapshot>> Scene::publish(const Prepared& prepared) {
  std::vector<std::shared_ptr<const Snapshot>> forgotten;
  const std::lock_guard lock(mutex_);
  assert(!pending_.empty() && prepared.snapshot == pending_.front());
  pending_.pop_front();
  recent_.push_back(prepared.snapshot);
  while (recent_.size() > std::max(1u, limits_.revisions)) {
    forgotten.push_back(std::move(recent_.front()));
    recent_.pop_front();
  }
  return forgotten;
}

void Scene::drop_pending(Revision first) {
  std::vector<std::shared_ptr<const Snapshot>> dropped;  // freed after the mutex
  const std::lock_guard lock(mutex_);
  while (!pending_.empty() && pending_.back()->revision >= first) {
    dropped.push_back(std::move(pending_.back()));
    pending_.pop_back();
  }
}

std::shared_ptr<const Snapshot> Scene::head() const {
  const std::lock_guard lock(mutex_);
  return recent_.back();
}

std::shared_ptr<const Snapshot> Scene::pending() const {
  const std::lock_guard lock(mutex_);
  return last();
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
