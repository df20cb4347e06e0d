// Snapshots: they bound the journal and the time to recover. See journal.h.
#include <algorithm>

#include "server/journal/journal.h"

namespace heliograph::server {

void Journal::snapshot_if_due() {
  if (head_.last() - snapshot_at_ < options_.snapshot_records) return;
  std::set<u64> scenes;
  {
    const std::lock_guard lock(mutex_);
    if (is_encoding_ || is_refusing_) return;
    is_encoding_ = true;
    scenes.swap(changed_scenes_);
  }
  snapshot_at_ = head_.last();
  auto states = std::make_shared<std::vector<SceneState>>(capture(scenes));
  const auto end = [this, scenes](const Status& made) {
    if (!made) log_.warning("the journal has no new snapshot", {{"reason", made.error().message}});
    const std::lock_guard lock(mutex_);
    if (!made) changed_scenes_.insert(scenes.begin(), scenes.end());
    is_encoding_ = false;
    ready_.notify_all();
  };
  const auto posted =
      pool_.post([this, end, states, record = head_.last(), sum = head_.last_sum()] {
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
    auto stored = store_state(state, files(state.row.tenant()));
    if (!stored) return std::unexpected(std::move(stored).error());
    state.row.set_record(record);
    control->files.emplace(state.row.scene(), std::move(*stored));
    control->added.push_back(std::move(state.row));
  }
  return control;
}

void Journal::sweep() {
  const std::lock_guard lock(files_mutex_);
  for (const auto& [tenant, store] : files_) store->sweep();
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
  if (!database_) return;
  if (auto made = last_snapshot(); !made)
    log_.warning("the journal has no last snapshot", {{"reason", made.error().message}});
  database_.reset();
}

Status Journal::last_snapshot() {
  if (changed_scenes_.empty()) return {};
  auto control = encode(capture(changed_scenes_), head_.last(), head_.last_sum());
  if (!control) return std::unexpected(std::move(control).error());
  std::vector<Item> group;
  Status committed;
  group.push_back(
      {.entry = {.sync = true, .done = [&](const Status& status) { committed = status; }},
       .control = std::move(*control)});
  commit(std::move(group));
  HELIO_TRY(committed);
  sweep();
  return database_ ? database_->checkpoint(true) : Status();
}

}  // namespace heliograph::server
