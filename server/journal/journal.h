// The journal of durable scenes: what was acknowledged survives the daemon. Called by the scenes
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

/// What of a record is written: serialised, with the files it names.
struct Entry {
  u64 scene = 0;
  std::string tenant = {};
  std::string record;
  bool sync = false;  // survives a loss of power
  std::vector<BlobFilePtr> files = {};
  /// Called once, from the writer's thread, for a tenant in the order of append(): committed, or an
  /// error and then nothing of it will be there after a restart.
  std::function<void(const Status&)> done;
  Charge charge = {};  // of the tenant's disk; append() takes it
};

/// Owns: the state directory, the database, and the thread that writes it. Thread: any.
///
/// Entries that wait are committed together, up to a megabyte of them, in a fair order of tenants.
/// After a commit that waited for the disk, those who
/// were answered are given a moment to send their next ones, so that all share the next wait: as
/// many entries as before, or half the time that the disk took, 0.1 ms at most. After an error
/// nothing is acknowledged: all that waits fails, the database is closed, and once a second it is
/// opened again, brought to what was acknowledged, and moved out of its log; when that works,
/// writing goes on. Was the disk full, the room for this comes from a reserve, scenes can be
/// removed then, and edits go on once the reserve is there again.
///
/// A snapshot is due after a number of records, or after as many bytes as the scenes themselves
/// have; also when somebody found no room.
class Journal {
 public:
  struct Options {
    std::string folder;
    u64 snapshot_records = 100'000;    // between two snapshots
    u64 snapshot_bytes = 64ull << 20;  // the same, and more where scenes have more
    u64 queue = 65'536;                // entries of one tenant that may wait
    u64 reserve = 16ull << 20;         // bytes: see DiskRoom
    u64 spare = 1ull << 30;
    /// A tenant's share of the disk, by its name.
    std::function<std::shared_ptr<Budget>(const std::string&)> disk;
  };
  /// Called when writing stops (an error) and when it goes on (OK).
  using Changed = std::function<void(const Status&)>;
  /// The states of these scenes, as far as their entries were done; of `row` only the id is read.
  /// Called by the writer's thread.
  using Capture = std::function<std::vector<SceneState>(const std::set<u64>& scenes)>;

  /// Takes the folder. ALREADY_EXISTS: another daemon has it; INTERNAL: it is damaged;
  /// UNIMPLEMENTED: its format is not known.
  [[nodiscard]] static Expected<std::unique_ptr<Journal>> open(Options options, WorkPool& pool,
                                                               const Log& log);
  ~Journal();

  using ReadScene = std::function<Status(const journal::SceneRow&)>;
  /// A record, its number, and its transaction; null: that is a file of its own.
  using ReadRecord = std::function<Status(u64, const journal::Record&, const v1::Transaction*)>;
  /// What there is to recover: rows of scenes, then the records that are not in all snapshots, in
  /// order; the sum of each is checked. INTERNAL names the first row that is damaged. Another
  /// thread reads ahead.
  [[nodiscard]] Status read(const ReadScene& scene, const ReadRecord& record);
  /// Files that recovery found a scene to need; `record` 0: by its snapshot.
  void hold(u64 scene, u64 record, std::vector<BlobFilePtr> files);
  /// Begins to write; files that nothing holds are removed, and what was saved for this daemon:
  /// it has that now. A directory of an earlier format has this one from here on.
  [[nodiscard]] Status start(Capture capture, Changed changed);

  /// UNAVAILABLE or RESOURCE_EXHAUSTED while it does not write, or its tenant has no room; nothing
  /// is called then.
  [[nodiscard]] Status append(Entry entry);
  /// Adds or removes a scene; returns when that is committed.
  [[nodiscard]] Status add(SceneState state);
  [[nodiscard]] Status remove(u64 scene, const std::string& tenant);
  /// There was no room for somebody: what is superseded goes soon.
  void want_room();
  /// What became of save().
  struct Saved {
    u64 scenes = 0;
    u64 bytes = 0;
    u64 lost = 0;    // could not be saved
    Status because;  // why the last of these not
  };
  /// Adds scenes that are not durable, so that the next daemon has them: all that fit into `bytes`
  /// on the disk, what scenes share once, in one commit. Returns when that is done.
  [[nodiscard]] Saved save(std::vector<SceneState> states, u64 bytes);
  /// OK while it writes, else why not.
  [[nodiscard]] Status status() const;
  /// What was wrong with the log at the start, and what that means; "": nothing.
  [[nodiscard]] const std::string& damage() const { return damage_; }
  /// Refuses what comes, commits what waits, writes snapshots, ends the thread.
  void stop();

  [[nodiscard]] BlobFiles& files(const std::string& tenant);

 private:
  /// A change of the rows of scenes.
  struct Control {
    std::vector<journal::SceneRow> added;  // or replaced, by a snapshot
    std::map<u64, std::vector<BlobFilePtr>> files;
    std::optional<u64> removed;
    bool is_snapshot = false;
    u64 record = 0;  // of a snapshot: the last one that is in it
    u64 sum = 0;     // of that record
    u64 bytes = 0;   // that were stored for it, without arrays
  };
  struct Item {
    Entry entry;
    std::shared_ptr<Control> control;  // null: a record
    u64 record = 0;
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
  void snapshot_here();  // by the caller, while the thread does not run
  [[nodiscard]] Status encode_here();
  [[nodiscard]] Status shrink_wholly();
  /// Of SQLite's log, before they are moved into the database: what half the reserve has.
  [[nodiscard]] int log_pages() const { return int(room_->reserve() / 2 / kPageBytes) + 1; }
  void sweep();

  const Options options_;
  WorkPool& pool_;
  const Log& log_;
  UniqueFd lock_;
  std::unique_ptr<DiskRoom> room_;
  std::atomic<bool> may_remove_ = true;                      // files
  std::unique_ptr<Database> database_;                       // writer's; null while it is broken
  std::map<std::string, std::unique_ptr<BlobFiles>> files_;  // by tenant
  std::mutex files_mutex_;
  Capture capture_;
  Changed changed_;

  std::string damage_;  // what was wrong with the log when it was opened

  // The writer's alone, once it runs.
  using Files = std::vector<BlobFilePtr>;
  journal::Head head_;                     // as committed
  std::map<u64, journal::SceneRow> rows_;  // as committed
  std::map<u64, journal::SceneRow> next_rows_;
  std::map<u64, Files> state_files_;                               // of each scene's snapshot
  std::map<u64, std::deque<std::pair<u64, Files>>> record_files_;  // of its records since
  u64 oldest_ = 1;                                    // record that may still be in the database
  u64 erased_ = 256;                                  // old records that go with each commit
  u64 snapshot_at_ = 0;                               // record of the last snapshot
  u64 snapshot_bytes_ = 0;                            // stored for it
  u64 bytes_since_ = 0;                               // of records and their files
  std::map<std::string, Charge> charges_;             // of records, by tenant
  std::map<std::string, Charge> old_charges_;         // of those in the snapshot that is made
  bool has_free_ = false;                             // pages
  std::size_t last_group_ = 0;                        // entries of the last commit
  std::chrono::steady_clock::duration last_sync_{0};  // how long it took, where it synced

  mutable std::mutex mutex_;
  std::condition_variable ready_;
  WriteQueue<Item> queue_;
  std::size_t wanted_ = 1;  // so many entries wake the writer
  Status status_;
  std::set<u64> changed_scenes_;                           // since their snapshot
  bool is_encoding_ = false;                               // a snapshot is being made
  bool wants_room_ = false;                                // so one is due
  std::chrono::steady_clock::time_point next_snapshot_{};  // that is made for room
  bool is_full_ = false;  // the disk was: the reserve is gone, only removals are written
  bool is_refusing_ = false;
  bool is_stopping_ = false;
  std::thread thread_;
};

}  // namespace heliograph::server
