// The token that loopback TCP clients send: loopback is open to every local user, a file is not.
#pragma once

#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Reads the token file, or creates it (mode 0600, 32 random bytes in hexadecimal).
/// PERMISSION_DENIED when others may read it.
[[nodiscard]] Expected<std::string> load_token(const std::string& path);

}  // namespace heliograph::server
