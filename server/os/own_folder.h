// Folders that other users must not get at. Used by accept.cpp and the journal.
#pragma once

#include <string>

#include "renderer/base/error.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

enum class Others : u8 { kMayRead, kMayNothing };

/// Opens a folder of the daemon's user or of root. PERMISSION_DENIED, at `flag`, when it is
/// somebody else's or lets others do more; UNAVAILABLE when it cannot be opened.
[[nodiscard]] Expected<UniqueFd> open_own_folder(const std::string& folder, Others others,
                                                 const char* flag);

}  // namespace heliograph::server
