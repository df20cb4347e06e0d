// The writer: waiting records become one transaction of the database. See journal.h.
#include "server/journal/journal.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <future>

#include "server/os/mutant.h"
#include "server/session/session.h"

namespace heliograph::server {
namespace {

constexpr u64 kGroupBytes = 1 << 20;  // bytes per commit
constexpr u64 kErasedMost = 256;      // old records erased per commit
constexpr u64 kErasedBytes = 4 << 20;
constexpr u64 kRecordBytes = 96;     // overhead of a record
constexpr u64 kControlBytes = 4096;  // cost of a Control in the queue
constexpr auto kLookAround = std::chrono::seconds(1);
constexpr auto kGather = std::chrono::microseconds(100);

}  // namespace

// ---------------------------------------------------------------- any thread

Status Journal::push(Item item, bool is_ours) {
  const bool frees = item.control && (item.control->removed || item.control->is_snapshot);
  const u64 bytes = item.control ? kControlBytes : item.record.body.size() + kRecordBytes;
  {
    const std::lock_guard lock(mutex_);
    if (!status_ && !(is_full_ && frees)) return status_;
    if (is_refusing_ && !is_ours) return shutting_down();
    if (queue_.size_of(item.record.tenant) >= options_.queue)
      return busy(
          fmt::format("{} edits wait for the disk already; retry later (limit journal_queue)",
                      options_.queue),
          "journal_queue");
    const std::string tenant = item.record.tenant;
    queue_.push(tenant, bytes, std::move(item));
    if (queue_.size() < wanted_) return {};
  }
  ready_.notify_all();
  return {};
}

Status Journal::append(JournalRecord record) {
  auto charge = files(record.tenant).charge(record.body.size() + kRecordBytes, Room::kEdit);
  if (!charge) {
    want_room();
    return std::unexpected(std::move(charge).error());
  }
  record.charge = std::move(*charge);
  return push({.record = std::move(record), .control = nullptr}, false);
}

void Journal::want_room() {
  {
    const std::lock_guard lock(mutex_);
    wants_room_ = true;
  }
  ready_.notify_all();
}

Status Journal::run(std::shared_ptr<Control> control, const std::string& tenant) {
  auto done = std::make_shared<std::promise<Status>>();
  auto result = done->get_future();
  JournalRecord record{.tenant = tenant, .sync = true, .done = [done](const Status& status) {
                         done->set_value(status);
                       }};
  const bool is_ours = control->is_snapshot;
  HELIO_TRY(push({.record = std::move(record), .control = std::move(control)}, is_ours));
  return result.get();
}

Status Journal::add(SceneState state) {
  const std::string tenant = state.row.tenant();
  auto stored = store_state(state, files(tenant), Room::kEdit);
  if (!stored) {
    want_room();
    return std::unexpected(std::move(stored).error());
  }
  auto control = std::make_shared<Control>();
  control->files.emplace(state.row.scene(), std::move(*stored));
  control->added.push_back(std::move(state.row));
  return run(std::move(control), tenant);
}

Status Journal::remove(u64 scene, const std::string& tenant) {
  auto control = std::make_shared<Control>();
  control->removed = scene;
  HELIO_TRY(run(std::move(control), tenant));
  files(tenant).sweep();
  return {};
}

Status Journal::status() const {
  const std::lock_guard lock(mutex_);
  return status_;
}

BlobFiles& Journal::files(const std::string& tenant) {
  const std::lock_guard lock(files_mutex_);
  auto& files = files_[tenant];
  if (!files)
    files = std::make_unique<BlobFiles>(
        BlobFiles::Options{.folder = fmt::format("{}/blobs/{}", options_.folder, tenant),
                           .disk = options_.disk(tenant),
                           .room = *room_,
                           .may_remove = may_remove_});
  return *files;
}

// ---------------------------------------------------------------- the writer's thread

bool Journal::may_make_room() const {
  return wants_room_ && !is_encoding_ && !is_refusing_ &&
         std::chrono::steady_clock::now() >= next_snapshot_;
}

bool Journal::wait(std::vector<Item>& group) {
  std::unique_lock lock(mutex_);
  const bool has_more = oldest_ < head_.first() || has_free_;
  ready_.wait_for(lock, kLookAround,
                  [&] { return queue_.size() > 0 || is_stopping_ || may_make_room() || has_more; });
  if (queue_.size() > 0) gather(lock);
  group = queue_.take(kGroupBytes);
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
  do {
    if (!group.empty() || oldest_ < head_.first()) commit(std::move(group));
    group.clear();
    shrink();
    if (!database_ && !open_again()) return;
    snapshot_if_due();
    resume();
  } while (wait(group));
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
  for (const Item& item : group) sync |= item.record.sync;
  HELIO_TRY(database_->begin(sync));
  for (Item& item : group) {
    if (item.control) {
      HELIO_TRY(write(*item.control, next));
      continue;
    }
    item.number = next.last() + 1;
    next.set_last_sum(sum_of(next.last_sum(), item.number, item.record.body));
    next.set_last(item.number);
    HELIO_TRY(database_->put(Rows::kRecords, item.number, item.record.body, next.last_sum()));
  }
  if (oldest_ < head_.first())
    HELIO_TRY(database_->erase(Rows::kRecords, oldest_,
                               std::min(head_.first(), oldest_ + erased_ + group.size()) - 1));
  const std::string body = next.SerializeAsString();
  HELIO_TRY(database_->put(Rows::kHead, 0, body, sum_of(0, 0, body)));
  return database_->commit();
}

void Journal::commit(std::vector<Item> group) {
  journal::Head next = head_;
  const bool has_control =
      std::ranges::any_of(group, [](const Item& item) { return item.control != nullptr; });
  if (has_control) next_rows_ = rows_;
  const bool has_synced = std::ranges::any_of(group, [](const Item& i) { return i.record.sync; });
  const auto start = std::chrono::steady_clock::now();
  if (auto written = write(group, next); !written && !has_bug("ignore_error"))
    return stall(std::move(group), written.error());
  last_group_ = group.size();
  last_sync_ = (std::chrono::steady_clock::now() - start) * has_synced;
  oldest_ = std::min(head_.first(), oldest_ + erased_ + group.size());
  head_ = next;
  if (has_control) rows_ = std::move(next_rows_);
  {
    const std::lock_guard lock(mutex_);
    for (const Item& item : group)
      if (!item.control) changed_scenes_.insert(item.record.scene);
  }
  for (Item& item : group) {
    account(item);
    adopt(item);
    item.record.done({});
  }
  if (database_->log_pages() < log_pages()) return;
  if (auto moved = database_->checkpoint(false); !moved) stall({}, moved.error());
}

/// Updates byte counts and charges. A record's charge is released once a snapshot, which is charged
/// first, contains it.
void Journal::account(Item& item) {
  if (!item.control) {
    bytes_since_ += item.record.body.size();
    for (const BlobFilePtr& file : item.record.files) bytes_since_ += size_of(*file);
    charges_[item.record.tenant].merge(std::move(item.record.charge));
    return;
  }
  if (!item.control->is_snapshot) return;
  u64 bytes = 1;
  for (const auto& [tenant, charge] : old_charges_) bytes += charge.amount();
  const u64 records = head_.first() - oldest_;
  erased_ = std::clamp<u64>(records * kErasedBytes / bytes, 1, kErasedMost);
  old_charges_.clear();
  snapshot_bytes_ = item.control->bytes;
  room_->expect_snapshot(snapshot_bytes_);
  has_free_ = true;
}

void Journal::adopt(Item& item) {
  if (!item.control) {
    if (!item.record.files.empty() && rows_.contains(item.record.scene))
      record_files_[item.record.scene].emplace_back(item.number, std::move(item.record.files));
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

}  // namespace heliograph::server
