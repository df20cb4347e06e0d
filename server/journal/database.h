// SQLite as the journal uses it: rows of bytes with checksums, written in transactions. Used by the
// journal's files.
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

/// Format of the state directory, stored as user_version. 0 is the first format, without a number;
/// since then large transactions are files, and the file can shrink.
inline constexpr int kFormat = 2;

/// Owns: the connection and its lock on the file. Thread: one at a time.
///
/// Fails with RESOURCE_EXHAUSTED (disk full), INTERNAL (file damaged), UNIMPLEMENTED (another
/// format), UNAVAILABLE (anything else, including a failed fsync). After a failure in begin() to
/// commit() it must be closed: the content of the file is unknown until it is opened again.
class Database {
 public:
  /// Opens or creates the file; check: verifies its pages too. The format is kFormat, or 0 until
  /// set_format().
  [[nodiscard]] static Expected<std::unique_ptr<Database>> open(const std::string& path,
                                                                bool check);
  ~Database();
  Database(const Database&) = delete;

  /// sync   the commit survives a loss of power, not only the end of the process
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
  /// Reads from this id on, up to so many rows or bytes.
  struct Range {
    u64 first = 0;
    u64 rows = 0;
    u64 bytes = ~u64(0);
  };
  /// Reads rows by ascending id; an error of `read` ends it.
  [[nodiscard]] Status each(Rows rows, const Range& range,
                            const std::function<Status(const Row&)>& read);
  /// Returns the smallest id; 0: no rows.
  [[nodiscard]] Expected<u64> first(Rows rows);

  /// Checkpoint: moves committed pages from the log into the file and syncs it. whole: until the
  /// log is empty.
  [[nodiscard]] Status checkpoint(bool whole);
  /// Returns the pages in the log since the last checkpoint.
  [[nodiscard]] int log_pages() const { return log_pages_; }
  /// Removes up to `most` free pages from the file, leaving `kept`. Returns true when no more are
  /// left to remove; the file is shorter after the next checkpoint.
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
  bool shrinks_ = false;  // without a VACUUM
  int format_ = 0;
  int log_pages_ = 0;
};

/// Returns the checksum of a row; a record's includes the previous record's, so that a missing one
/// is noticed.
[[nodiscard]] u64 sum_of(u64 before, u64 id, std::string_view body);

}  // namespace heliograph::server
