// What throws becomes an error of the job.
#include "renderer/base/guard.h"

#include <stdexcept>

#include "tests/unit/catch.h"

using namespace heliograph;

TEST_CASE("guard: memory and faults of libraries are errors of the job") {
  const auto code = [](auto throws) {
    return guard([&]() -> Status { return throws(), Status{}; }).error().code;
  };
  CHECK(guard([]() -> Status { return {}; }).has_value());
  CHECK(code([] { throw std::bad_alloc(); }) == Code::kResourceExhausted);
  CHECK(code([] { throw std::length_error("too long"); }) == Code::kInternal);
  const Status told = guard([]() -> Status { throw std::runtime_error("lost"); });
  CHECK(told.error().message == "a fault of the renderer, which goes on: lost");
}
