// Which traceparents name a trace: those of W3C Trace Context, section 3.2.
#include "server/os/trace.h"

#include "tests/unit/catch.h"

using namespace heliograph::server;

namespace {

const std::string kTrace = "4bf92f3577b34da6a3ce929d0e0e4736", kSpan = "00f067aa0ba902b7";
const std::string kParent = "00-" + kTrace + "-" + kSpan + "-01";

}  // namespace

TEST_CASE("trace: a parent names trace and span") {
  const Trace trace = parse_trace(kParent, "vendor=1,other=2");
  REQUIRE(bool(trace));
  CHECK(trace.trace_id() == kTrace);
  CHECK(trace.span_id() == kSpan);
  CHECK(trace.parent == kParent);
  CHECK(trace.state == "vendor=1,other=2");
}

TEST_CASE("trace: what breaks a rule names none") {
  std::string upper = kParent, zero_trace = kParent, zero_span = kParent, dash = kParent;
  upper[3] = 'A';
  zero_trace.replace(3, 32, 32, '0');
  zero_span.replace(36, 16, 16, '0');
  dash[35] = '_';
  const std::string version_ff = "ff" + kParent.substr(2), half = kParent.substr(0, 54);
  for (const std::string& parent :
       {upper, zero_trace, zero_span, dash, version_ff, half, kParent + "-", kParent + "0",
        "0x" + kParent.substr(2), kParent.substr(0, 53) + "0g", std::string()})
    CHECK_FALSE(bool(parse_trace(parent, "")));
}

TEST_CASE("trace: of a later version what this one has is taken") {
  const std::string later = "cc" + kParent.substr(2);
  CHECK(parse_trace(later, "").trace_id() == kTrace);
  CHECK(parse_trace(later + "-what-comes", "").parent == later);
  CHECK_FALSE(bool(parse_trace(later + ".what-comes", "")));
}

TEST_CASE("trace: a state that is long or not printable is left out, the trace stays") {
  CHECK(parse_trace(kParent, std::string(512, 'x')).state.size() == 512);
  CHECK(parse_trace(kParent, std::string(513, 'x')).state.empty());
  CHECK(parse_trace(kParent, "a=\n").state.empty());
  CHECK(parse_trace(kParent, "a=\xc3\xa4").parent == kParent);
}
