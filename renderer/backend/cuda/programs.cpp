#include "renderer/backend/cuda/programs.h"

#if defined(HELIO_PROGRAMS)  // the path of the compiled programs

asm(".section .rodata\n"
    ".balign 16\n"
    "heliograph_programs_begin:\n"
    ".incbin \"" HELIO_PROGRAMS
    "\"\n"
    "heliograph_programs_end:\n"
    ".previous\n");

extern "C" {
extern const std::byte heliograph_programs_begin[];
extern const std::byte heliograph_programs_end[];
}

namespace heliograph::cuda {

std::span<const std::byte> programs() {
  return {heliograph_programs_begin, heliograph_programs_end};
}

}  // namespace heliograph::cuda

#else

namespace heliograph::cuda {

std::span<const std::byte> programs() { return {}; }

}  // namespace heliograph::cuda

#endif
