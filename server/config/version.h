// The version that CMake's project() states. Told by --version and GetServerInfo.
#pragma once

namespace heliograph::server {

inline constexpr const char* kVersion = HELIOGRAPH_VERSION;

}  // namespace heliograph::server
