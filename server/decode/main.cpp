// heliograph-decode: decodes one untrusted file and ends. It confines itself, reports its sandbox,
// and waits for its job. Started by the daemon with its descriptors (wire.h), ahead of time.
#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <thread>

#include "renderer/assets/load.h"
#include "server/decode/child.h"
#include "server/decode/sandbox.h"

namespace heliograph::server {
namespace {

constexpr unsigned kMostThreads = 8;  // their stacks share the address space limit
constexpr int kNice = 10;             // a ninth of a render thread's scheduling weight

u64 number(const char* text) {
  u64 value = 0;
  const char* end = text + std::strlen(text);
  const auto [at, error] = std::from_chars(text, end, value);
  return error == std::errc() && at == end ? value : 0;
}

/// without   names of layers, each followed by a comma
decode::Hello hello_of(const SandboxReport& report, std::string_view without) {
  decode::Hello hello;
  for (const std::string& layer : report.active) hello.add_sandbox(layer);
  for (const std::string& refused : report.refused) {
    const bool is_spared =
        without.find(std::string(name_of(refused)) + ",") != std::string_view::npos;
    (is_spared ? hello.add_refused() : hello.add_missing())->assign(refused);
  }
  hello.set_versions(decoder_versions());
  return hello;
}

void silence() {
  const Fd nothing(open("/dev/null", O_RDWR | O_CLOEXEC));
  for (int fd = 0; fd < 3; ++fd) dup2(nothing.get(), fd);
}

int run(int count, char** arguments) {
  if (count != 5) {
    std::fputs(
        "heliograph-decode is started by heliographd: MEMORY_BYTES CPU_SECONDS FILE_BYTES "
        "WITHOUT_LAYERS\n",
        stderr);
    return 64;
  }
  silence();
  const auto sandbox = Sandbox::prepare({.memory_bytes = number(arguments[1]),
                                         .cpu_seconds = u32(number(arguments[2])),
                                         .file_bytes = number(arguments[3])});
  if (!sandbox) {
    decode::Hello refused;
    refused.add_missing(sandbox.error().message);
    (void)send_packet(kSocket, PacketKind::kHello, refused.SerializeAsString());
    return 0;
  }
  (void)!nice(kNice);
  mallopt(M_ARENA_MAX, 2);  // one arena per thread would exceed the address space
  static Helpers helpers;
  const unsigned threads = std::clamp(std::thread::hardware_concurrency(), 1u, kMostThreads);
  const SandboxReport report = sandbox->enter([&] {
    end_picture_threads();
    helpers.start(threads - 1);
  });
  const decode::Hello hello = hello_of(report, arguments[4]);
  if (!send_packet(kSocket, PacketKind::kHello, hello.SerializeAsString())) return 0;
  if (hello.missing_size() > 0) return 0;
  const auto go = receive_packet(kSocket);
  if (!go || !*go || (*go)->kind != PacketKind::kGo) return 0;
  if (const auto job = Region::map(kJobRegion, ~0ull)) run_job(**job, helpers);
  return 0;
}

}  // namespace
}  // namespace heliograph::server

int main(int count, char** arguments) {
  _exit(heliograph::server::run(count, arguments));  // without joining helper threads
}
