// Stops writing after an error, and resumes it. See journal.h.
#include <algorithm>
#include <chrono>
#include <functional>
#include <limits>

#include "server/journal/journal.h"

namespace heliograph::server {
namespace {

constexpr double kReopenSeconds = 1;
constexpr u64 kLastId = std::numeric_limits<i64>::max();

}  // namespace

void Journal::stall(std::vector<Item> group, const Error& why) {
  database_.reset();
  may_remove_ = false;
  Error error{.code = why.code == Code::kResourceExhausted ? why.code : Code::kUnavailable,
              .message = "the scene is read-only, because its journal cannot be written: " +
                         why.message + "; the daemon tries again, and goes on when it can",
              .where = ""};
  error.retry_seconds = kReopenSeconds;
  {
    const std::lock_guard lock(mutex_);
    status_ = std::unexpected(error);
    // A removal is tried once with the room of the reserve, and alone.
    const bool had_reserve = !is_full_, was_alone = group.size() == 1;
    is_full_ = wants_room_ = why.code == Code::kResourceExhausted;
    const auto waits = [&](const Item& item) {
      return is_full_ && (had_reserve || !was_alone) && item.control && item.control->removed;
    };
    for (Item& item : queue_.take_all()) group.push_back(std::move(item));
    const auto kept = std::stable_partition(group.begin(), group.end(), std::not_fn(waits));
    for (auto item = kept; item != group.end(); ++item)
      queue_.push(item->record.tenant, 0, std::move(*item));
    group.erase(kept, group.end());
  }
  changed_(std::unexpected(why));
  for (Item& item : group) item.record.done(std::unexpected(error));
}

void Journal::fail_waiting(const Error& error) {
  std::vector<Item> waiting;
  {
    const std::lock_guard lock(mutex_);
    waiting = queue_.take_all();
  }
  for (Item& item : waiting) item.record.done(std::unexpected(error));
}

/// Opens the database again, at once where there was a reserve, else once per second. False: the
/// journal ends before that succeeds.
bool Journal::open_again() {
  bool at_once;
  Error error;
  {
    const std::lock_guard lock(mutex_);
    at_once = is_full_;
    error = status_.error();
  }
  for (; !database_; at_once = false) {
    if (!at_once) {
      fail_waiting(error);
      std::unique_lock lock(mutex_);
      const auto pause = std::chrono::duration<double>(kReopenSeconds);
      const bool ends = ready_.wait_for(lock, pause, [&] { return is_stopping_; });
      lock.unlock();
      if (ends) {
        fail_waiting(error);
        return false;
      }
    }
    if (auto opened = reopen(); !opened)
      log_.debug("the journal still fails", {{"reason", opened.error().message}});
  }
  may_remove_ = true;
  return true;
}

/// After an error it is unknown what the file contains and what is on the disk: checkpoints and
/// syncs all that it shows, and erases what was not acknowledged.
Status Journal::reopen() {
  if (is_full_) room_->release_reserve();
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
  return {};
}

/// Accepts edits again once the reserve is allocated for the next time.
void Journal::resume() {
  {
    const std::lock_guard lock(mutex_);
    if (status_) return;
  }
  if (is_full_ && !room_->take_reserve()) return;
  {
    const std::lock_guard lock(mutex_);
    status_ = {};
    is_full_ = false;
  }
  changed_({});
}

}  // namespace heliograph::server
