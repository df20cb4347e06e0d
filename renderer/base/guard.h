// Handling of memory that runs out, and of faults of libraries. Used by the engine.
#pragma once

#include <exception>
#include <new>
#include <string>

#include "renderer/base/error.h"

namespace heliograph {

/// Memory may run out anywhere, and a library may fail: errors of the job, not of the process.
template <class F>
auto guard(F&& f) -> decltype(f()) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return fail(Code::kResourceExhausted, "", "out of memory; ask for less at once");
  } catch (const std::exception& error) {
    return fail(Code::kInternal, "",
                std::string("a fault of the renderer, which goes on: ") + error.what());
  }
}

}  // namespace heliograph
