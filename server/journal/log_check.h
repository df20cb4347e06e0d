// What SQLite does not tell: whether it will drop pages of its log because they are damaged.
#pragma once

#include <string>

namespace heliograph::server {

/// "" when the write-ahead log at `path` ends where it was written last, or is not there. Otherwise
/// which page is the first damaged one and how many after it are dropped. Read before SQLite does.
///
/// Source: "WAL-mode File Format", sqlite.org/walformat.html, 1 and 2.
[[nodiscard]] std::string check_log(const std::string& path);

}  // namespace heliograph::server
