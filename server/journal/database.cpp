// SQLite in WAL mode, one exclusive connection. See database.h.
#include "server/journal/database.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <cstring>
#include <iterator>

#include "server/os/hash.h"
#include "server/os/mutant.h"

namespace heliograph::server {
namespace {

constexpr const char* kTables[] = {"head", "scenes", "records"};
constexpr i64 kApplication = 0x48656c69;  // application_id "Heli", in the file's header
constexpr i64 kIncremental = 2;  // auto_vacuum INCREMENTAL: free pages are removed on request

const char* text_of(sqlite3_stmt* statement, int column) {
  return reinterpret_cast<const char*>(sqlite3_column_text(statement, column));
}

}  // namespace

std::unexpected<Error> Database::broken(int code) const {
  const std::string what = db_ ? sqlite3_errmsg(db_) : sqlite3_errstr(code);
  const int system = db_ ? sqlite3_system_errno(db_) : 0;
  const std::string why = system == 0 ? what : fmt::format("{} (errno {})", what, system);
  switch (code & 0xff) {
    case SQLITE_FULL:
      return fail(Code::kResourceExhausted, "", "the disk is full: " + why);
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return fail(Code::kInternal, "", "the database is damaged: " + why);
    default:
      return fail(Code::kUnavailable, "", "the database failed: " + why);
  }
}

Status Database::run(const char* sql) {
  const int code = sqlite3_exec(db_, sql, nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) return broken(code);
  return {};
}

Expected<std::unique_ptr<Database>> Database::open(const std::string& path, bool check) {
  std::unique_ptr<Database> made(new Database());
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX;
  const int code = sqlite3_open_v2(path.c_str(), &made->db_, flags, nullptr);
  if (code != SQLITE_OK) return made->broken(code);
  sqlite3_extended_result_codes(made->db_, 1);
  sqlite3_wal_hook(
      made->db_,
      [](void* self, sqlite3*, const char*, int pages) {
        static_cast<Database*>(self)->log_pages_ = pages;
        return SQLITE_OK;
      },
      made.get());
  HELIO_TRY(made->set_up());
  if (check) HELIO_TRY(made->check_pages());
  return made;
}

Status Database::set_up() {
  HELIO_TRY(
      run("PRAGMA locking_mode=EXCLUSIVE; PRAGMA cell_size_check=ON; PRAGMA secure_delete=OFF;"
          "PRAGMA temp_store=MEMORY;"));
  const auto tables = number("SELECT count(*) FROM sqlite_master");
  if (!tables) return std::unexpected(tables.error());
  if (*tables != 0) HELIO_TRY(check_format());
  // Before tables exist: later it would need a VACUUM.
  if (*tables == 0) HELIO_TRY(run("PRAGMA auto_vacuum=INCREMENTAL"));
  HELIO_TRY(run("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL;"));
  is_syncing_ = true;
  if (*tables == 0) HELIO_TRY(make());
  const auto vacuum = number("PRAGMA auto_vacuum");
  if (!vacuum) return std::unexpected(vacuum.error());
  shrinks_ = *vacuum == kIncremental;
  return prepare();
}

Status Database::make() {
  HELIO_TRY(begin(true));
  for (const char* table : kTables)
    HELIO_TRY(run(fmt::format("CREATE TABLE {} (id INTEGER PRIMARY KEY, body BLOB NOT NULL, "
                              "sum INTEGER NOT NULL)",
                              table)
                      .c_str()));
  HELIO_TRY(set_format());
  return commit();
}

Status Database::set_format() {
  format_ = kFormat;
  return run(fmt::format("PRAGMA application_id={}; PRAGMA user_version={}", kApplication, kFormat)
                 .c_str());
}

Status Database::check_format() {
  const auto application = number("PRAGMA application_id");
  if (!application) return std::unexpected(application.error());
  const auto version = number("PRAGMA user_version");
  if (!version) return std::unexpected(version.error());
  const auto known = number(
      "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND "
      "name IN ('head', 'scenes', 'records')");
  if (!known) return std::unexpected(known.error());
  if ((*application != kApplication && (*application != 0 || *version != 0)) ||
      *known != i64(std::size(kTables)))
    return fail(Code::kUnimplemented, "",
                fmt::format("journal.db is another program's (application_id {}, user_version {}); "
                            "name a directory of the daemon's own, or move the file away",
                            *application, *version));
  if (*version > kFormat)
    return fail(Code::kUnimplemented, "",
                fmt::format("has format {}, this heliographd knows formats up to {}: start the "
                            "version that wrote it or a newer one, or name another directory",
                            *version, kFormat));
  format_ = int(*version);
  return {};
}

Expected<i64> Database::number(const char* sql) {
  sqlite3_stmt* statement = nullptr;
  int code = sqlite3_prepare_v2(db_, sql, -1, &statement, nullptr);
  if (code != SQLITE_OK) return broken(code);
  code = sqlite3_step(statement);
  const i64 found = code == SQLITE_ROW ? sqlite3_column_int64(statement, 0) : 0;
  sqlite3_finalize(statement);
  if (code != SQLITE_ROW) return broken(code);
  return found;
}

Expected<bool> Database::shrink(i64 kept, i64 most) {
  const auto free = number("PRAGMA freelist_count");
  if (!free) return std::unexpected(free.error());
  if (*free <= kept) return true;
  if (!shrinks_) {  // an earlier format: one VACUUM
    HELIO_TRY(run("PRAGMA auto_vacuum=INCREMENTAL; VACUUM"));
    shrinks_ = true;
    return true;
  }
  const i64 gone = std::min(*free - kept, most);
  HELIO_TRY(run(fmt::format("PRAGMA incremental_vacuum({})", gone).c_str()));
  return *free - gone <= kept;
}

Status Database::check_pages() {
  sqlite3_stmt* check = nullptr;
  const int code = sqlite3_prepare_v2(db_, "PRAGMA quick_check(1)", -1, &check, nullptr);
  if (code != SQLITE_OK) return broken(code);
  const int found = sqlite3_step(check);
  const std::string says = found == SQLITE_ROW ? text_of(check, 0) : sqlite3_errmsg(db_);
  sqlite3_finalize(check);
  if (says == "ok") return {};
  return fail(Code::kInternal, "", "the database is damaged: " + says);
}

Database::~Database() {
  for (const Statements& statements : statements_)
    for (sqlite3_stmt* statement : {statements.put, statements.erase, statements.read})
      sqlite3_finalize(statement);
  sqlite3_close(db_);
}

Status Database::prepare() {
  for (std::size_t i = 0; i < std::size(kTables); ++i) {
    const std::pair<sqlite3_stmt**, const char*> all[] = {
        {&statements_[i].put, "INSERT OR REPLACE INTO {} VALUES (?1, ?2, ?3)"},
        {&statements_[i].erase, "DELETE FROM {} WHERE id BETWEEN ?1 AND ?2"},
        {&statements_[i].read, "SELECT id, body, sum FROM {} WHERE id >= ?1 ORDER BY id LIMIT ?2"}};
    for (const auto& [statement, sql] : all) {
      const std::string text = fmt::format(fmt::runtime(sql), kTables[i]);
      const int code =
          sqlite3_prepare_v3(db_, text.c_str(), -1, SQLITE_PREPARE_PERSISTENT, statement, nullptr);
      if (code != SQLITE_OK) return broken(code);
    }
  }
  return {};
}

Status Database::begin(bool sync) {
  if (has_bug("skip_fsync")) sync = false;
  if (sync != is_syncing_) {
    HELIO_TRY(run(sync ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=NORMAL"));
    is_syncing_ = sync;
  }
  return run("BEGIN IMMEDIATE");
}

Status Database::commit() { return run("COMMIT"); }

Status Database::step(sqlite3_stmt* statement) {
  const int code = sqlite3_step(statement);
  sqlite3_reset(statement);
  if (code != SQLITE_DONE) return broken(code);
  return {};
}

Status Database::put(Rows rows, u64 id, std::string_view body, u64 sum) {
  sqlite3_stmt* put = statements_[std::size_t(rows)].put;
  sqlite3_bind_int64(put, 1, i64(id));
  sqlite3_bind_blob64(put, 2, body.data(), body.size(), SQLITE_STATIC);
  sqlite3_bind_int64(put, 3, i64(sum));
  return step(put);
}

Status Database::erase(Rows rows, u64 first, u64 last) {
  sqlite3_stmt* erase = statements_[std::size_t(rows)].erase;
  sqlite3_bind_int64(erase, 1, i64(first));
  sqlite3_bind_int64(erase, 2, i64(last));
  return step(erase);
}

Status Database::each(Rows rows, const Range& range,
                      const std::function<Status(const Row&)>& read) {
  sqlite3_stmt* select = statements_[std::size_t(rows)].read;
  sqlite3_bind_int64(select, 1, i64(range.first));
  sqlite3_bind_int64(select, 2, i64(range.rows));
  Status status;
  int code = SQLITE_DONE;
  u64 had = 0;
  while (status && had < range.bytes && (code = sqlite3_step(select)) == SQLITE_ROW) {
    const auto* bytes = static_cast<const char*>(sqlite3_column_blob(select, 1));
    const auto size = std::size_t(sqlite3_column_bytes(select, 1));
    had += size;
    status = read({.id = u64(sqlite3_column_int64(select, 0)),
                   .body = {bytes, size},
                   .sum = u64(sqlite3_column_int64(select, 2))});
  }
  if (status && code != SQLITE_DONE && code != SQLITE_ROW) status = broken(code);
  sqlite3_reset(select);
  return status;
}

Expected<u64> Database::first(Rows rows) {
  sqlite3_stmt* select = statements_[std::size_t(rows)].read;
  sqlite3_bind_int64(select, 1, 0);
  sqlite3_bind_int64(select, 2, 1);
  const int code = sqlite3_step(select);
  const u64 id = code == SQLITE_ROW ? u64(sqlite3_column_int64(select, 0)) : 0;
  sqlite3_reset(select);
  if (code != SQLITE_ROW && code != SQLITE_DONE) return broken(code);
  return id;
}

Status Database::checkpoint(bool whole) {
  const int mode = whole ? SQLITE_CHECKPOINT_TRUNCATE : SQLITE_CHECKPOINT_PASSIVE;
  const int code = sqlite3_wal_checkpoint_v2(db_, nullptr, mode, nullptr, nullptr);
  if (code != SQLITE_OK) return broken(code);
  log_pages_ = 0;
  return {};
}

u64 sum_of(u64 before, u64 id, std::string_view body) {
  Sha256 digest;
  const u64 head[] = {before, id};
  digest.add(std::as_bytes(std::span(head)));
  digest.add(body);
  u64 sum;
  std::memcpy(&sum, digest.finish().data(), sizeof sum);
  return sum;
}

}  // namespace heliograph::server
