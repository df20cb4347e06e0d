// What becomes of memory that runs out. Used by the engine.
#pragma once

#include <new>

#include "renderer/base/error.h"

namespace heliograph {

/// Memory is the one thing that may run out anywhere: an error of the job, not of the process.
template <class F>
auto guard(F&& f) -> decltype(f()) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return fail(Code::kResourceExhausted, "", "out of memory; ask for less at once");
  }
}

}  // namespace heliograph
