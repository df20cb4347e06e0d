// Snapshots: they bound the journal and the time to recover. See journal.h.
#include <algorithm>
#include <limits>
#include <utility>

#include "server/journal/journal.h"

namespace heliograph::server {
namespace {

constexpr u64 kLogOf = 16;  // fraction of the disk: 1 / kLogOf
constexpr auto kBetween = std::chrono::seconds(1);
constexpr i64 kShrunkAtOnce = 1'000;  // pages, 4 MB

}  // namespace

/// Due at most once per second when room is wanted, since each costs a whole snapshot.
bool Journal::is_due() {
  const u64 most =
      std::max(std::min(options_.snapshot_bytes, room_->size() / kLogOf), snapshot_bytes_);
  bool is_due = head_.last() - snapshot_at_ >= options_.snapshot_records || bytes_since_ >= most;
  const auto now = std::chrono::steady_clock::now();
  if (now < next_snapshot_ && !is_due) return false;
  is_due |= std::exchange(wants_room_, false) && head_.last() >= head_.first();
  if (is_due) next_snapshot_ = now + kBetween;
  return is_due;
}

void Journal::snapshot_if_due() {
  std::set<u64> scenes;
  {
    const std::lock_guard lock(mutex_);
    if (is_encoding_ || is_refusing_ || !is_due()) return;
    is_encoding_ = true;
    scenes.swap(changed_scenes_);
  }
  begin_snapshot();
  auto states = std::make_shared<std::vector<SceneState>>(capture(scenes));
  const auto end = [this, scenes](const Status& made) {
    if (!made) log_.warning("the journal has no new snapshot", {{"reason", made.error().message}});
    const std::lock_guard lock(mutex_);
    if (!made) {
      changed_scenes_.insert(scenes.begin(), scenes.end());
      wants_room_ = true;
    }
    is_encoding_ = false;
    ready_.notify_all();
  };
  const auto posted = pool_.post(
      WorkPool::kDaemon, [this, end, states, record = head_.last(), sum = head_.last_sum()] {
        auto control = encode(std::move(*states), record, sum);
        Status made;
        if (control)
          made = run(std::move(*control));
        else
          made = std::unexpected(control.error());
        if (made) sweep();
        end(made);
      });
  if (!posted) end(posted);
}

/// Restarts the counts of records and bytes for the next snapshot.
void Journal::begin_snapshot() {
  snapshot_at_ = head_.last();
  bytes_since_ = 0;
  for (auto& [tenant, charge] : charges_) old_charges_[tenant].merge(std::move(charge));
  charges_.clear();
}

std::vector<SceneState> Journal::capture(const std::set<u64>& scenes) {
  std::vector<SceneState> states = capture_(scenes);
  std::erase_if(states, [&](SceneState& state) {
    const auto row = rows_.find(state.row.scene());
    if (row != rows_.end()) state.row = row->second;
    return row == rows_.end();
  });
  return states;
}

Expected<std::shared_ptr<Journal::Control>> Journal::encode(std::vector<SceneState> states,
                                                            u64 record, u64 sum) {
  auto control = std::make_shared<Control>();
  control->is_snapshot = true;
  control->record = record;
  control->sum = sum;
  for (SceneState& state : states) {
    auto stored = store_state(state, files(state.row.tenant()), Room::kSnapshot);
    if (!stored) return std::unexpected(std::move(stored).error());
    control->bytes += size_of(*stored->back());
    state.row.set_record(record);
    control->files.emplace(state.row.scene(), std::move(*stored));
    control->added.push_back(std::move(state.row));
  }
  return control;
}

/// Removes files without a handle. Appends take the lock for a lookup, so no file in use is
/// removed; entries of files_ are never erased.
void Journal::sweep() {
  std::vector<BlobFiles*> stores;
  {
    const std::lock_guard lock(files_mutex_);
    for (const auto& [tenant, store] : files_) stores.push_back(store.get());
  }
  for (BlobFiles* store : stores) store->sweep();
}

/// Shrinks the file, a part at a time, once no old record is left.
void Journal::shrink() {
  if (!database_ || !has_free_ || oldest_ < head_.first()) return;
  auto all = database_->shrink(log_pages(), kShrunkAtOnce);
  if (all && !*all) return;
  has_free_ = false;
  Status moved = all ? database_->checkpoint(true) : std::unexpected(std::move(all).error());
  if (!moved) stall({}, moved.error());
}

void Journal::stop() {
  {
    std::unique_lock lock(mutex_);
    if (!thread_.joinable()) return;
    is_refusing_ = true;
    ready_.wait(lock, [this] { return !is_encoding_; });
    is_stopping_ = true;
  }
  ready_.notify_all();
  thread_.join();
  room_->release_reserve();
  if (!database_) return;
  snapshot_here();
  if (auto shrunk = shrink_wholly(); !shrunk)
    log_.warning("the journal keeps what it does not need", {{"reason", shrunk.error().message}});
  database_.reset();
}

Status Journal::shrink_wholly() {
  while (database_ && oldest_ < head_.first()) commit({});
  if (!database_) return status();
  if (auto all = database_->shrink(0, std::numeric_limits<i64>::max()); !all)
    return std::unexpected(std::move(all).error());
  return database_->checkpoint(true);
}

void Journal::snapshot_here() {
  if (auto made = encode_here(); !made)
    log_.warning("the journal has no new snapshot", {{"reason", made.error().message}});
}

Status Journal::encode_here() {
  if (changed_scenes_.empty()) return {};
  auto control = encode(capture(changed_scenes_), head_.last(), head_.last_sum());
  if (!control) return std::unexpected(std::move(control).error());
  begin_snapshot();
  std::vector<Item> group;
  Status committed;
  group.push_back(
      {.record = {.sync = true, .done = [&](const Status& status) { committed = status; }},
       .control = std::move(*control)});
  commit(std::move(group));
  HELIO_TRY(committed);
  changed_scenes_.clear();
  sweep();
  return {};
}

}  // namespace heliograph::server
