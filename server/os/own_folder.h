// Folders protected from other users. Used by accept.cpp and the journal.
#pragma once

#include <string>

#include "renderer/base/error.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

enum class Others : u8 { kMayRead, kOwnerOnly };

/// Opens a folder owned by the daemon's user or by root. PERMISSION_DENIED, at `flag`, when another
/// user owns it or `others` may do more; UNAVAILABLE when it cannot be opened.
[[nodiscard]] Expected<UniqueFd> open_own_folder(const std::string& folder, Others others,
                                                 const char* flag);

}  // namespace heliograph::server
