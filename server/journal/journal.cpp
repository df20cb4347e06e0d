// The writer: entries that wait are one transaction of the database. See journal.h.
#include "server/journal/journal.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <future>
#include <limits>

#include "server/os/mutant.h"
#include "server/session/session.h"

namespace heliograph::server {
namespace {

constexpr int kLogPages = 2'000;     // 8 MB: then they are moved into the database
constexpr u64 kErasedAtLeast = 256;  // old records, with each commit
constexpr double kReopenSeconds = 1;
constexpr auto kGather = std::chrono::microseconds(100);
constexpr u64 kLastId = std::numeric_limits<i64>::max();

}  // namespace

// ---------------------------------------------------------------- any thread

Status Journal::push(Item item, bool is_ours) {
  {
    const std::lock_guard lock(mutex_);
    if (!status_) return status_;
    if (is_refusing_ && !is_ours) return shutting_down();
    if (queue_.size() >= options_.queue)
      return busy("too many edits wait for the disk; retry later");
    queue_.push_back(std::move(item));
    if (queue_.size() < wanted_) return {};
  }
  ready_.notify_all();
  return {};
}

Status Journal::append(Entry entry) {
  return push({.entry = std::move(entry), .control = nullptr}, false);
}

Status Journal::run(std::shared_ptr<Control> control) {
  auto done = std::make_shared<std::promise<Status>>();
  auto result = done->get_future();
  Entry entry{.sync = true, .done = [done](const Status& status) { done->set_value(status); }};
  const bool is_ours = control->is_snapshot;
  HELIO_TRY(push({.entry = std::move(entry), .control = std::move(control)}, is_ours));
  return result.get();
}

Status Journal::add(SceneState state) {
  auto stored = store_state(state, files(state.row.tenant()));
  if (!stored) return std::unexpected(std::move(stored).error());
  auto control = std::make_shared<Control>();
  control->files.emplace(state.row.scene(), std::move(*stored));
  control->added.push_back(std::move(state.row));
  return run(std::move(control));
}

Status Journal::remove(u64 scene) {
  auto control = std::make_shared<Control>();
  control->removed = scene;
  return run(std::move(control));
}

Status Journal::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

BlobFiles& Journal::files(const std::string& tenant) {
  const std::lock_guard lock(files_mutex_);
  auto& files = files_[tenant];
  if (!files)
    files = std::make_unique<BlobFiles>(fmt::format("{}/blobs/{}", options_.folder, tenant));
  return *files;
}

// ---------------------------------------------------------------- the writer's thread

bool Journal::wait(std::vector<Item>& group) {
  std::unique_lock lock(mutex_);
  const bool has_old = oldest_ < head_.first();
  ready_.wait(lock, [&] { return !queue_.empty() || is_stopping_ || has_old; });
  gather(lock);
  group.assign(std::make_move_iterator(queue_.begin()), std::make_move_iterator(queue_.end()));
  queue_.clear();
  return !group.empty() || !is_stopping_;
}

void Journal::gather(std::unique_lock<std::mutex>& lock) {
  const auto moment = std::min<std::chrono::steady_clock::duration>(last_sync_ / 2, kGather);
  wanted_ = last_group_;
  ready_.wait_for(lock, moment, [&] { return queue_.size() >= wanted_ || is_stopping_; });
  wanted_ = 1;
}

void Journal::work() {
  std::vector<Item> group;
  while (wait(group)) {
    commit(std::move(group));
    group.clear();
    while (!database_) {
      {
        std::unique_lock lock(mutex_);
        const auto pause = std::chrono::duration<double>(kReopenSeconds);
        if (ready_.wait_for(lock, pause, [&] { return is_stopping_; })) return;
      }
      if (auto opened = reopen(); !opened)
        log_.debug("the journal still fails", {{"reason", opened.error().message}});
    }
    snapshot_if_due();
  }
}

Status Journal::write(Control& control, journal::Head& next) {
  for (journal::SceneRow& row : control.added) {
    if (!control.is_snapshot) row.set_record(next.last());
    if (control.is_snapshot && !next_rows_.contains(row.scene())) continue;  // deleted meanwhile
    const std::string body = row.SerializeAsString();
    HELIO_TRY(database_->put(Rows::kScenes, row.scene(), body, sum_of(0, row.scene(), body)));
    next_rows_[row.scene()] = row;
  }
  if (control.removed) {
    HELIO_TRY(database_->erase(Rows::kScenes, *control.removed, *control.removed));
    next_rows_.erase(*control.removed);
  }
  if (control.is_snapshot) {
    next.set_first(control.record + 1);
    next.set_first_sum(control.sum);
  }
  next.set_scenes(next_rows_.size());
  return {};
}

Status Journal::write(std::vector<Item>& group, journal::Head& next) {
  bool sync = false;
  for (const Item& item : group) sync |= item.entry.sync;
  HELIO_TRY(database_->begin(sync));
  for (Item& item : group) {
    if (item.control) {
      HELIO_TRY(write(*item.control, next));
      continue;
    }
    item.record = next.last() + 1;
    next.set_last_sum(sum_of(next.last_sum(), item.record, item.entry.record));
    next.set_last(item.record);
    HELIO_TRY(database_->put(Rows::kRecords, item.record, item.entry.record, next.last_sum()));
  }
  if (oldest_ < head_.first())
    HELIO_TRY(
        database_->erase(Rows::kRecords, oldest_,
                         std::min(head_.first() - 1, oldest_ + kErasedAtLeast + group.size())));
  const std::string body = next.SerializeAsString();
  HELIO_TRY(database_->put(Rows::kHead, 0, body, sum_of(0, 0, body)));
  return database_->commit();
}

void Journal::commit(std::vector<Item> group) {
  journal::Head next = head_;
  const bool has_control =
      std::ranges::any_of(group, [](const Item& item) { return item.control != nullptr; });
  if (has_control) next_rows_ = rows_;
  const bool has_synced = std::ranges::any_of(group, [](const Item& i) { return i.entry.sync; });
  const auto start = std::chrono::steady_clock::now();
  if (auto written = write(group, next); !written && !has_bug("ignore_error"))
    return stall(std::move(group), written.error());
  last_group_ = group.size();
  last_sync_ = (std::chrono::steady_clock::now() - start) * has_synced;
  oldest_ = std::min(head_.first(), oldest_ + kErasedAtLeast + group.size() + 1);
  head_ = next;
  if (has_control) rows_ = std::move(next_rows_);
  {
    const std::lock_guard lock(mutex_);
    for (const Item& item : group)
      if (!item.control) changed_scenes_.insert(item.entry.scene);
  }
  for (Item& item : group) {
    adopt(item);
    item.entry.done({});
  }
  if (database_->log_pages() < kLogPages) return;
  if (auto moved = database_->checkpoint(false); !moved) stall({}, moved.error());
}

void Journal::adopt(Item& item) {
  if (!item.control) {
    if (!item.entry.files.empty() && rows_.contains(item.entry.scene))
      record_files_[item.entry.scene].emplace_back(item.record, std::move(item.entry.files));
    return;
  }
  Control& control = *item.control;
  for (const journal::SceneRow& row : control.added) {
    if (!rows_.contains(row.scene())) continue;
    state_files_[row.scene()] = std::move(control.files[row.scene()]);
    auto& since = record_files_[row.scene()];
    while (!since.empty() && since.front().first <= row.record()) since.pop_front();
  }
  if (control.removed) {
    state_files_.erase(*control.removed);
    record_files_.erase(*control.removed);
  }
}

void Journal::stall(std::vector<Item> group, const Error& why) {
  database_.reset();
  Error error{.code = why.code == Code::kResourceExhausted ? why.code : Code::kUnavailable,
              .message = "the scene is read-only, because its journal cannot be written: " +
                         why.message + "; the daemon tries again, and goes on when it can",
              .where = ""};
  error.retry_seconds = kReopenSeconds;
  {
    const std::lock_guard lock(mutex_);
    status_ = std::unexpected(error);
    for (Item& item : queue_) group.push_back(std::move(item));
    queue_.clear();
  }
  changed_(std::unexpected(why));
  for (Item& item : group) item.entry.done(std::unexpected(error));
}

/// What the file holds after an error is not known, nor whether it is on the disk: all that it
/// shows is moved out of the log and synced, and what was not acknowledged is taken out again.
Status Journal::reopen() {
  auto opened = Database::open(path(), false);
  if (!opened) return std::unexpected(std::move(opened).error());
  Database& database = **opened;
  HELIO_TRY(database.checkpoint(true));
  HELIO_TRY(database.begin(true));
  HELIO_TRY(database.erase(Rows::kRecords, head_.last() + 1, kLastId));
  HELIO_TRY(database.erase(Rows::kScenes, 0, kLastId));
  for (const auto& [scene, row] : rows_) {
    const std::string body = row.SerializeAsString();
    HELIO_TRY(database.put(Rows::kScenes, scene, body, sum_of(0, scene, body)));
  }
  const std::string body = head_.SerializeAsString();
  HELIO_TRY(database.put(Rows::kHead, 0, body, sum_of(0, 0, body)));
  HELIO_TRY(database.commit());
  HELIO_TRY(database.checkpoint(true));
  database_ = std::move(*opened);
  {
    const std::lock_guard lock(mutex_);
    status_ = {};
  }
  changed_({});
  return {};
}

}  // namespace heliograph::server
