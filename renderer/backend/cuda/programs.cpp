#include "renderer/backend/cuda/programs.h"

#if defined(HELIO_PROGRAMS_LIST)  // a file of HELIO_PROGRAMS(name, path) for each fat binary

#define HELIO_PROGRAMS(name, path) \
  asm(".section .rodata\n"         \
      ".balign 16\n"               \
      "heliograph_programs_" #name \
      ":\n"                        \
      ".incbin \"" path            \
      "\"\n"                       \
      ".previous\n");              \
  extern "C" const std::byte heliograph_programs_##name[];
#include HELIO_PROGRAMS_LIST
#undef HELIO_PROGRAMS

namespace heliograph::cuda {

std::span<const std::byte* const> programs() {
#define HELIO_PROGRAMS(name, path) heliograph_programs_##name,
  static const std::byte* const all[] = {
#include HELIO_PROGRAMS_LIST
  };
#undef HELIO_PROGRAMS
  return all;
}

}  // namespace heliograph::cuda

#else

namespace heliograph::cuda {

std::span<const std::byte* const> programs() { return {}; }

}  // namespace heliograph::cuda

#endif
