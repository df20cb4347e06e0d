// SQLite as the journal uses it: rows of bytes with checksums, written in transactions. Used by
// journal.cpp and recovery.cpp.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "renderer/base/error.h"

struct sqlite3;
struct sqlite3_stmt;

namespace heliograph::server {

/// The kinds of rows.
enum class Rows : u8 { kHead, kScenes, kRecords };

/// The format of the state directory, as the file's user_version says it. 0 is the one without such
/// a number; what changed since: large transactions are files, and the file is made to shrink.
inline constexpr int kFormat = 2;

/// Owns: the connection and its lock on the file. Thread: one at a time.
///
/// Fails with RESOURCE_EXHAUSTED (the disk is full), INTERNAL (the file is damaged), UNIMPLEMENTED
/// (it has another format), UNAVAILABLE (anything else, an fsync that failed too). After a failure
/// of begin() to commit() it must be closed: what the file holds is known only after it was opened
/// again.
class Database {
 public:
  /// Opens or makes the file; `check`: and checks its pages. Its format is kFormat, or 0 until
  /// set_format().
  [[nodiscard]] static Expected<std::unique_ptr<Database>> open(const std::string& path,
                                                                bool check);
  ~Database();
  Database(const Database&) = delete;

  /// `sync`: the commit survives a loss of power, not only the end of the process.
  [[nodiscard]] Status begin(bool sync);
  [[nodiscard]] Status put(Rows rows, u64 id, std::string_view body, u64 sum);
  /// Rows first to last.
  [[nodiscard]] Status erase(Rows rows, u64 first, u64 last);
  [[nodiscard]] Status commit();
  [[nodiscard]] int format() const { return format_; }
  /// Between begin() and commit().
  [[nodiscard]] Status set_format();

  struct Row {
    u64 id = 0;
    std::string_view body;
    u64 sum = 0;
  };
  /// From this id on, until there were so many rows or bytes.
  struct Range {
    u64 first = 0;
    u64 rows = 0;
    u64 bytes = ~u64(0);
  };
  /// In the order of ids; an error of `read` ends it.
  [[nodiscard]] Status each(Rows rows, const Range& range,
                            const std::function<Status(const Row&)>& read);
  /// The smallest id, 0 when there is none.
  [[nodiscard]] Expected<u64> first(Rows rows);

  /// Moves what was committed from the log into the file, and syncs it; `whole`: until the log is
  /// empty.
  [[nodiscard]] Status checkpoint(bool whole);
  /// Pages of the log since the last checkpoint.
  [[nodiscard]] int log_pages() const { return log_pages_; }
  /// Takes `most` pages that are free out of the file, but leaves `kept` of them. Whether that was
  /// all; the file is shorter after the next checkpoint.
  [[nodiscard]] Expected<bool> shrink(i64 kept, i64 most);

 private:
  Database() = default;
  [[nodiscard]] Status run(const char* sql);
  [[nodiscard]] Status set_up();
  [[nodiscard]] Status make();
  [[nodiscard]] Status check_format();
  [[nodiscard]] Expected<i64> number(const char* sql);
  [[nodiscard]] Status prepare();
  [[nodiscard]] Status check_pages();
  [[nodiscard]] Status step(sqlite3_stmt* statement);
  [[nodiscard]] std::unexpected<Error> broken(int code) const;

  struct Statements {
    sqlite3_stmt* put = nullptr;
    sqlite3_stmt* erase = nullptr;
    sqlite3_stmt* read = nullptr;
  };
  sqlite3* db_ = nullptr;
  Statements statements_[3];
  bool is_syncing_ = false;
  bool shrinks_ = false;  // without being made anew
  int format_ = 0;
  int log_pages_ = 0;
};

/// Checksum of a row; of a record together with the one before, so that none can be missing.
[[nodiscard]] u64 sum_of(u64 before, u64 id, std::string_view body);

}  // namespace heliograph::server
