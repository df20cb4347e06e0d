// Seeded bugs that test the tests: compiled only into the mutants that tests/CMakeLists.txt builds,
// no code in a daemon.
#pragma once

#include <cstdlib>
#include <string_view>

namespace heliograph::server {

#ifdef HELIOGRAPH_MUTANTS
/// Returns true when the environment asks for this bug.
inline bool has_bug(std::string_view name) {
  const char* chosen = std::getenv("HELIOGRAPH_MUTANT");
  return chosen && name == chosen;
}
#else
constexpr bool has_bug(std::string_view) { return false; }
#endif

}  // namespace heliograph::server
