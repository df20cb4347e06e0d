// Opens the state directory and reads its content. See journal.h.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <google/protobuf/arena.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <future>
#include <iterator>
#include <limits>

#include "server/convert/fields.h"
#include "server/journal/journal.h"
#include "server/journal/log_check.h"
#include "server/os/own_folder.h"

namespace heliograph::server {
namespace {

constexpr const char* kHeadFormat = "heliograph.journal.2";
constexpr const char* kFirstFormat = "heliograph.journal.1";  // user_version 0
constexpr u64 kAll = std::numeric_limits<i64>::max();
constexpr u64 kBatch = 1024;  // records read ahead while earlier ones are applied
constexpr u64 kBatchBytes = 1 << 20;

std::unexpected<Error> damaged(const std::string& what) {
  return fail(Code::kInternal, "--state-dir",
              what + "; restore the directory from a backup, or move it away");
}

/// A batch of records and parsed transactions, which live as long as it does.
struct Batch {
  struct Each {
    u64 id = 0;
    const journal::Record* record = nullptr;
    const v1::Transaction* transaction = nullptr;
  };
  google::protobuf::Arena arena;
  std::vector<Each> records;
  u64 bytes = 0;
  u64 last = 0;  // number and checksum of the last record, or of the one before an empty batch
  u64 sum = 0;
  Status status;  // reason why there are no more
};

Status read_row(const Database::Row& row, Batch& batch) {
  auto* record = google::protobuf::Arena::CreateMessage<journal::Record>(&batch.arena);
  v1::Transaction* transaction = nullptr;
  if (row.id != batch.last + 1) return damaged(fmt::format("record {} is missing", batch.last + 1));
  if (sum_of(batch.sum, row.id, row.body) != row.sum ||
      !record->ParseFromArray(row.body.data(), int(row.body.size())))
    return damaged(fmt::format("record {} is damaged", row.id));
  if (record->transaction_file().empty())
    transaction = google::protobuf::Arena::CreateMessage<v1::Transaction>(&batch.arena);
  if (transaction && !transaction->ParseFromString(record->transaction()))
    return damaged(fmt::format("record {} is damaged", row.id));
  batch.records.push_back({.id = row.id, .record = record, .transaction = transaction});
  batch.bytes += row.body.size();
  batch.last = row.id;
  batch.sum = row.sum;
  return {};
}

/// Reads the records after `last`, whose checksum is `sum`; an empty batch: the end.
std::unique_ptr<Batch> read_batch(Database& database, u64 last, u64 sum) {
  auto batch = std::make_unique<Batch>();
  batch->last = last;
  batch->sum = sum;
  batch->status =
      database.each(Rows::kRecords, {.first = last + 1, .rows = kBatch, .bytes = kBatchBytes},
                    [&](const Database::Row& row) { return read_row(row, *batch); });
  return batch;
}

}  // namespace

Expected<std::unique_ptr<Journal>> Journal::open(Options options, WorkPool& pool, const Log& log) {
  std::unique_ptr<Journal> made(new Journal(std::move(options), pool, log));
  HELIO_TRY(made->take_folder());
  made->room_ = std::make_unique<DiskRoom>(DiskRoom::Options{.folder = made->options_.folder,
                                                             .reserve = made->options_.reserve,
                                                             .spare = made->options_.spare});
  made->room_->release_reserve();  // left by a killed daemon: its room lets a full disk be opened
  made->damage_ = check_log(made->path() + "-wal");
  auto database = Database::open(made->path(), true);
  if (!database && database.error().code == Code::kInternal)
    return damaged(database.error().message);
  if (!database) return std::unexpected(std::move(database).error().at("--state-dir"));
  made->database_ = std::move(*database);
  HELIO_TRY(made->read_head());
  return made;
}

Journal::~Journal() { stop(); }

Status Journal::take_folder() {
  const std::string& folder = options_.folder;
  HELIO_CHECK(make_folder(folder), "--state-dir");
  if (auto own = open_own_folder(folder, Others::kOwnerOnly, "--state-dir"); !own)
    return std::unexpected(std::move(own).error());
  HELIO_CHECK(make_folder(folder + "/blobs"), "--state-dir");
  lock_ = UniqueFd(::open((folder + "/lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (!lock_ || ::flock(lock_.get(), LOCK_EX | LOCK_NB) != 0)
    return fail(Code::kAlreadyExists, "--state-dir",
                folder + " is another daemon's, or is not writable; give each its own");
  // SQLite would create it world-readable, and its log with the same mode.
  const UniqueFd file(::open(path().c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
  if (!file || ::fchmod(file.get(), 0600) != 0)
    return fail(Code::kUnavailable, "--state-dir",
                fmt::format("cannot make {}: {}", path(), std::strerror(errno)));
  return {};
}

Status Journal::read_head() {
  const auto read = [this](const Database::Row& row) -> Status {
    if (sum_of(0, row.id, row.body) != row.sum ||
        !head_.ParseFromArray(row.body.data(), int(row.body.size())))
      return damaged("the head of the journal is damaged");
    if (head_.format() == (database_->format() == kFormat ? kHeadFormat : kFirstFormat)) return {};
    return fail(Code::kUnimplemented, "--state-dir",
                fmt::format("holds '{}', this heliographd reads '{}' and '{}': start the version "
                            "that wrote it, or name another directory",
                            head_.format(), kFirstFormat, kHeadFormat));
  };
  HELIO_TRY(database_->each(Rows::kHead, {.first = 0, .rows = 1}, read));
  const auto record = database_->first(Rows::kRecords), scene = database_->first(Rows::kScenes);
  if (!record) return std::unexpected(record.error());
  if (!scene) return std::unexpected(scene.error());
  if (head_.format().empty() && (*record != 0 || *scene != 0))
    return damaged("the head of the journal is missing");
  if (head_.format().empty()) head_.set_first(1);
  head_.set_format(kHeadFormat);  // written with the first commit of this run
  oldest_ = *record != 0 ? *record : head_.first();
  snapshot_at_ = head_.first() - 1;
  return {};
}

Status Journal::read(const ReadScene& scene, const ReadRecord& record) {
  const Status read = read_rows(scene, record);
  if (read || read.error().where == "--state-dir") return read;
  return damaged(read.error().where + ": " + read.error().message);
}

Status Journal::read_rows(const ReadScene& scene, const ReadRecord& record) {
  const auto read = [&](const Database::Row& row) -> Status {
    journal::SceneRow& next = rows_[row.id];
    if (sum_of(0, row.id, row.body) != row.sum ||
        !next.ParseFromArray(row.body.data(), int(row.body.size())))
      return damaged(fmt::format("the row of scene {} is damaged", row.id));
    return scene(next);
  };
  HELIO_TRY(database_->each(Rows::kScenes, {.first = 0, .rows = kAll}, read));
  if (rows_.size() != head_.scenes())
    return damaged(fmt::format("{} rows of scenes are missing", head_.scenes() - rows_.size()));
  return read_records(record);
}

Status Journal::read_records(const ReadRecord& record) {
  auto batch = read_batch(*database_, head_.first() - 1, head_.first_sum());
  std::map<u64, u64> bytes;  // by scene
  while (!batch->records.empty()) {
    // Large batches are not read ahead two at a time.
    const auto when = batch->bytes < kBatchBytes ? std::launch::async : std::launch::deferred;
    auto next = std::async(when, [this, last = batch->last, sum = batch->sum] {
      return read_batch(*database_, last, sum);
    });
    for (const auto& [id, each, transaction] : batch->records) {
      changed_scenes_.insert(each->scene());
      bytes[each->scene()] += each->ByteSizeLong();
      if (Status status = record(id, *each, transaction); !status)
        return std::unexpected(std::move(status).error().at(fmt::format("record {}", id)));
    }
    HELIO_TRY(batch->status);
    batch.reset();
    batch = next.get();
  }
  HELIO_TRY(batch->status);
  for (const auto& [scene, amount] : bytes) count(scene, amount);
  if (batch->last != head_.last() || batch->sum != head_.last_sum())
    return damaged(
        fmt::format("the records from {} to {} are missing", batch->last + 1, head_.last()));
  return {};
}

/// Returns the bytes of a scene's records.
void Journal::count(u64 scene, u64 bytes) {
  bytes_since_ += bytes;
  const auto row = rows_.find(scene);
  if (row == rows_.end()) return;  // the scene was deleted by a later record
  const std::string& tenant = row->second.tenant();
  charges_[tenant].merge(files(tenant).count(bytes));
}

void Journal::hold(u64 scene, u64 record, std::vector<BlobFilePtr> files) {
  auto& state = state_files_[scene];
  if (record == 0) {
    std::ranges::move(files, std::back_inserter(state));
    return;
  }
  for (const BlobFilePtr& file : files) bytes_since_ += size_of(*file);
  record_files_[scene].emplace_back(record, std::move(files));
}

Status Journal::start(Capture capture, Changed changed) {
  capture_ = std::move(capture);
  changed_ = std::move(changed);
  if (!damage_.empty())
    log_.warning("the end of the journal is lost: edits acknowledged last may be missing",
                 {{"damage", damage_}});
  head_.set_run(head_.run() + 1);
  HELIO_TRY(database_->begin(true));
  HELIO_TRY(forget_saved());
  const std::string body = head_.SerializeAsString();
  HELIO_TRY(database_->put(Rows::kHead, 0, body, sum_of(0, 0, body)));
  const int before = database_->format();
  if (before != kFormat) HELIO_TRY(database_->set_format());
  HELIO_TRY(database_->commit());
  if (before != kFormat)
    log_.warning("the state directory has a new format, which older versions do not read",
                 {{"before", before}, {"now", kFormat}});
  HELIO_TRY(database_->checkpoint(true));
  if (auto taken = room_->take_reserve(); !taken)
    log_.warning("the disk of the state directory is nearly full",
                 {{"available", taken.error().available}, {"needed", taken.error().needed}});
  std::error_code ignored;
  for (const auto& tenant :
       std::filesystem::directory_iterator(options_.folder + "/blobs", ignored))
    files(tenant.path().filename().string()).sweep(true);
  // With that many records the next start would take as long, and a daemon that soon ends again
  // would add more.
  if (head_.last() - snapshot_at_ >= options_.snapshot_records) snapshot_here();
  thread_ = std::thread([this] { work(); });
  return {};
}

/// Removes saved scenes in the commit that begins this run: a daemon killed after it must not leave
/// them, as clients may have edited them since.
Status Journal::forget_saved() {
  for (auto row = rows_.begin(); row != rows_.end();) {
    const auto each = row++;
    if (!each->second.saved()) continue;
    HELIO_TRY(database_->erase(Rows::kScenes, each->first, each->first));
    rows_.erase(each);
  }
  head_.set_scenes(rows_.size());
  return {};
}

}  // namespace heliograph::server
