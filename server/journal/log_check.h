// Detects damage in SQLite's write-ahead log, which SQLite drops silently.
#pragma once

#include <string>

namespace heliograph::server {

/// Returns "" when the write-ahead log at `path` ends where it was written last, or is missing;
/// otherwise which page is the first damaged one and how many after it are dropped. Call before
/// SQLite opens the file.
///
/// Source: "WAL-mode File Format", sqlite.org/walformat.html, 1 and 2.
[[nodiscard]] std::string check_log(const std::string& path);

}  // namespace heliograph::server
