// Journal of durable scenes: acknowledged edits survive the daemon. Called by the scenes
// (scenes.cpp) and by the daemon's start and end.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "server/journal/blob_files.h"
#include "server/journal/database.h"
#include "server/journal/disk_room.h"
#include "server/journal/record.pb.h"
#include "server/journal/state.h"
#include "server/journal/write_queue.h"
#include "server/os/log.h"
#include "server/os/unique_fd.h"
#include "server/os/work_pool.h"

namespace heliograph::server {

/// A record to write, with the files it names.
struct JournalRecord {
  u64 scene = 0;
  std::string tenant = {};
  std::string body;   // a serialised journal::Record
  bool sync = false;  // true: must survive a loss of power
  std::vector<BlobFilePtr> files = {};
  /// Called once, from the writer's thread, per tenant in the order of append(): OK once committed,
  /// or an error, after which nothing of it exists after a restart.
  std::function<void(const Status&)> done;
  Charge charge = {};  // of the tenant's disk quota; set by append()
};

/// Owns: the state directory, the database, and the thread that writes it. Thread: any.
///
/// Group commit: waiting records are committed together, up to 1 MiB, in a fair order of tenants.
/// After a commit that waited for the disk, the writer waits for the next records of the clients it
/// has just answered, so that they share the next sync: until as many as before wait, for half the
/// time of the last sync and 0.1 ms at most.
///
/// After an error nothing is acknowledged: all waiting records fail and the database is closed;
/// once per second it is opened again, reset to the acknowledged state, and checkpointed, after
/// which writing goes on. When the disk was full, a reserve provides the room for that: scenes can
/// be removed meanwhile, and edits go on once the reserve is allocated again.
///
/// A snapshot is due after a number of records, after as many bytes as the scenes themselves have,
/// and when want_room() was called.
class Journal {
 public:
  struct Options {
    std::string folder;
    u64 snapshot_records = 100'000;    // between two snapshots
    u64 snapshot_bytes = 64ull << 20;  // the same in bytes; more where scenes are larger
    u64 queue = 65'536;                // waiting records per tenant
    u64 reserve = 16ull << 20;         // bytes; see DiskRoom
    u64 spare = 1ull << 30;
    /// Returns a tenant's disk quota, by the tenant's name.
    std::function<std::shared_ptr<Budget>(const std::string&)> disk;
  };
  /// Called when writing stops (an error) and when it resumes (OK).
  using Changed = std::function<void(const Status&)>;
  /// Returns the states of these scenes, with the edits whose done() was called; `row` needs only
  /// the id. Thread: the writer's.
  using Capture = std::function<std::vector<SceneState>(const std::set<u64>& scenes)>;

  /// Opens and locks the folder. ALREADY_EXISTS: another daemon has it; INTERNAL: it is damaged;
  /// UNIMPLEMENTED: its format is unknown.
  [[nodiscard]] static Expected<std::unique_ptr<Journal>> open(Options options, WorkPool& pool,
                                                               const Log& log);
  ~Journal();

  using ReadScene = std::function<Status(const journal::SceneRow&)>;
  /// Reads a record: its number, and its transaction; null: that is in a file of its own.
  using ReadRecord = std::function<Status(u64, const journal::Record&, const v1::Transaction*)>;
  /// Reads everything to recover: rows of scenes, then the records that are not in all snapshots,
  /// in order, verifying checksums. INTERNAL names the first damaged row. Another thread reads
  /// ahead.
  [[nodiscard]] Status read(const ReadScene& scene, const ReadRecord& record);
  /// Keeps files that recovery found a scene to need; record 0: its snapshot needs them.
  void hold(u64 scene, u64 record, std::vector<BlobFilePtr> files);
  /// Starts the writer. Removes files without a handle, and scenes that an earlier daemon saved,
  /// which this one has recovered. Upgrades a directory of an earlier format.
  [[nodiscard]] Status start(Capture capture, Changed changed);

  /// Queues a record. UNAVAILABLE or RESOURCE_EXHAUSTED while the journal does not write, or the
  /// tenant has no room; done() is not called then.
  [[nodiscard]] Status append(JournalRecord record);
  /// Adds or removes a scene; returns once that is committed.
  [[nodiscard]] Status add(SceneState state);
  [[nodiscard]] Status remove(u64 scene, const std::string& tenant);
  /// Reports that something found no room: superseded data is removed soon.
  void want_room();
  /// Result of save().
  struct Saved {
    u64 scenes = 0;
    u64 bytes = 0;
    u64 lost = 0;    // scenes that could not be saved
    Status because;  // reason of the last one lost
  };
  /// Saves scenes that are not durable for the next daemon: all that fit into `bytes` on the disk,
  /// counting shared files once, in one commit. Returns once that is done.
  [[nodiscard]] Saved save(std::vector<SceneState> states, u64 bytes);
  /// Returns OK while it writes, else the reason why not.
  [[nodiscard]] Status status() const;
  /// Returns what was damaged in the log at the start, and the consequence; "": nothing.
  [[nodiscard]] const std::string& damage() const { return damage_; }
  /// Refuses new records, commits the waiting ones, writes snapshots, ends the thread.
  void stop();

  [[nodiscard]] BlobFiles& files(const std::string& tenant);

 private:
  /// A change of scenes' rows.
  struct Control {
    std::vector<journal::SceneRow> added;  // or replaced, by a snapshot
    std::map<u64, std::vector<BlobFilePtr>> files;
    std::optional<u64> removed;
    bool is_snapshot = false;
    u64 record = 0;  // of a snapshot: the last record in it
    u64 sum = 0;     // checksum of that record
    u64 bytes = 0;   // bytes stored for it, without arrays
  };
  struct Item {
    JournalRecord record;
    std::shared_ptr<Control> control;  // null: a record
    u64 number = 0;                    // number of the record, set when it is written
  };
  static constexpr u64 kPageBytes = 4096;
  Journal(Options options, WorkPool& pool, const Log& log)
      : options_(std::move(options)), pool_(pool), log_(log) {}
  [[nodiscard]] std::string path() const { return options_.folder + "/journal.db"; }
  [[nodiscard]] Status take_folder();
  [[nodiscard]] Status read_head();
  [[nodiscard]] Status read_rows(const ReadScene& scene, const ReadRecord& record);
  [[nodiscard]] Status read_records(const ReadRecord& record);
  void count(u64 scene, u64 bytes);
  [[nodiscard]] Status forget_saved();
  // journal.cpp: the writer
  [[nodiscard]] Status push(Item item, bool is_ours);
  [[nodiscard]] Status run(std::shared_ptr<Control> control, const std::string& tenant = "");
  void work();
  [[nodiscard]] bool may_make_room() const;  // under mutex_
  [[nodiscard]] bool wait(std::vector<Item>& group);
  void gather(std::unique_lock<std::mutex>& lock);
  void commit(std::vector<Item> group);
  void account(Item& item);
  [[nodiscard]] Status write(std::vector<Item>& group, journal::Head& next);
  [[nodiscard]] Status write(Control& control, journal::Head& next);
  void adopt(Item& item);
  // stall.cpp
  void stall(std::vector<Item> group, const Error& why);
  void fail_waiting(const Error& error);
  [[nodiscard]] bool open_again();
  [[nodiscard]] Status reopen();
  void resume();
  // saved.cpp
  [[nodiscard]] Expected<u64> store_within(SceneState& state, u64 bytes,
                                           std::set<const BlobFile*>& counted, Control& control);
  // snapshots.cpp
  [[nodiscard]] bool is_due();  // under mutex_
  void snapshot_if_due();
  void begin_snapshot();
  void shrink();
  [[nodiscard]] std::vector<SceneState> capture(const std::set<u64>& scenes);
  [[nodiscard]] Expected<std::shared_ptr<Control>> encode(std::vector<SceneState> states,
                                                          u64 record, u64 sum);
  void snapshot_here();  // in the caller's thread, while the writer does not run
  [[nodiscard]] Status encode_here();
  [[nodiscard]] Status shrink_wholly();
  /// Pages of SQLite's log that trigger a checkpoint: half the size of the reserve.
  [[nodiscard]] int log_pages() const { return int(room_->reserve() / 2 / kPageBytes) + 1; }
  void sweep();

  const Options options_;
  WorkPool& pool_;
  const Log& log_;
  UniqueFd lock_;
  std::unique_ptr<DiskRoom> room_;
  std::atomic<bool> may_remove_ = true;  // files may be removed
  std::unique_ptr<Database> database_;   // accessed by the writer; null while stalled
  std::map<std::string, std::unique_ptr<BlobFiles>> files_;  // by tenant
  std::mutex files_mutex_;
  Capture capture_;
  Changed changed_;

  std::string damage_;  // damage of the log at the start

  // Accessed by the writer only, once it runs.
  using Files = std::vector<BlobFilePtr>;
  journal::Head head_;                     // as committed
  std::map<u64, journal::SceneRow> rows_;  // as committed
  std::map<u64, journal::SceneRow> next_rows_;
  std::map<u64, Files> state_files_;                               // of each scene's snapshot
  std::map<u64, std::deque<std::pair<u64, Files>>> record_files_;  // of its records since
  u64 oldest_ = 1;          // first record that may still be in the database
  u64 erased_ = 256;        // old records erased with each commit
  u64 snapshot_at_ = 0;     // record of the last snapshot
  u64 snapshot_bytes_ = 0;  // bytes stored for it
  u64 bytes_since_ = 0;     // bytes of records and their files since the last snapshot
  std::map<std::string, Charge> charges_;             // of records, by tenant
  std::map<std::string, Charge> old_charges_;         // of the records in the snapshot being made
  bool has_free_ = false;                             // the database has free pages
  std::size_t last_group_ = 0;                        // records of the last commit
  std::chrono::steady_clock::duration last_sync_{0};  // duration of the last commit that synced

  mutable std::mutex mutex_;
  std::condition_variable ready_;
  WriteQueue<Item> queue_;
  std::size_t wanted_ = 1;  // queue length that wakes the writer
  Status status_;
  std::set<u64> changed_scenes_;                           // since their snapshot
  bool is_encoding_ = false;                               // a snapshot is being made
  bool wants_room_ = false;                                // a snapshot is due to free room
  std::chrono::steady_clock::time_point next_snapshot_{};  // earliest one for room
  bool is_full_ = false;  // the disk was full: the reserve is released, only removals are written
  bool is_refusing_ = false;
  bool is_stopping_ = false;
  std::thread thread_;
};

}  // namespace heliograph::server
