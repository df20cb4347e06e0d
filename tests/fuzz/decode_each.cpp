// Decodes every bundle that comes on stdin, each in a process of its own with the limits of
// heliograph-decode, and says on stdout what became of it. Used by tests/fault/fuzz_assets.py: a
// thousand files a second where a child of the daemon takes some hundredths of one.
//
// usage: decode-each MEMORY_BYTES CPU_SECONDS
// A bundle: u32 count, then for each file u32 and its path, u32 and its bytes. A line of answer:
// code, signal, CPU ms, wall ms, peak MiB and "where: message", with tabs between them.
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <new>
#include <string>
#include <vector>

#include "renderer/assets/load.h"

namespace heliograph {
namespace {

constexpr unsigned kDeadlineSeconds = 120;  // of the wall: one that hangs without computing

struct Files {
  std::vector<std::string> paths, contents;
};

bool read(void* out, std::size_t size) { return std::fread(out, 1, size, stdin) == size; }

bool read(std::string& out) {
  u32 size = 0;
  if (!read(&size, sizeof size)) return false;
  out.resize(size);
  return read(out.data(), size);
}

/// False: there are no more.
bool read(Files& files) {
  u32 count = 0;
  if (!read(&count, sizeof count)) return false;
  files.paths.resize(count);
  files.contents.resize(count);
  for (u32 i = 0; i < count; ++i)
    if (!read(files.paths[i]) || !read(files.contents[i])) return false;
  return true;
}

void confine([[maybe_unused]] rlim_t memory_bytes, rlim_t cpu_seconds) {
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // their shadow fits no limit
  const rlimit memory{memory_bytes, memory_bytes};
  setrlimit(RLIMIT_AS, &memory);
#endif
  const rlimit cpu{cpu_seconds, cpu_seconds + 1}, core{0, 0};
  setrlimit(RLIMIT_CPU, &cpu);
  setrlimit(RLIMIT_CORE, &core);
  alarm(kDeadlineSeconds);
}

/// As the daemon's clients do: what is missing is then said to be nowhere.
Expected<Loaded> load(const Files& files) {
  constexpr int kRounds = 64;
  std::vector<BundleFile> bundle;
  for (std::size_t i = 0; i < files.paths.size(); ++i)
    bundle.push_back({files.paths[i], std::as_bytes(std::span(files.contents[i]))});
  Expected<Loaded> loaded = load_asset(bundle, {});
  for (int round = 1; round < kRounds && loaded && !loaded->missing.empty(); ++round) {
    for (const std::string& path : loaded->missing) bundle.push_back({path, {}});
    loaded = load_asset(bundle, {});
  }
  return loaded;
}

std::string decoded(const Files& files) {
  const Expected<Loaded> loaded = load(files);
  if (loaded) return "0\t";
  return fmt::format("{}\t{}: {}", int(loaded.error().code), loaded.error().where,
                     loaded.error().message);
}

double milliseconds(const timeval& time) {
  return double(time.tv_sec) * 1e3 + double(time.tv_usec) / 1e3;
}

/// What a process says until its end.
std::string said(int fd) {
  std::string out;
  char part[4096];
  for (ssize_t got = 0; (got = ::read(fd, part, sizeof part)) > 0;)
    out.append(part, std::size_t(got));
  return out;
}

/// The line of a bundle.
std::string attempt(const Files& files, rlim_t memory_bytes, rlim_t cpu_seconds) {
  int ends[2];
  if (pipe(ends) != 0) std::abort();
  const auto start = std::chrono::steady_clock::now();
  const pid_t child = fork();
  if (child == 0) {
    confine(memory_bytes, cpu_seconds);
    const std::string answer = decoded(files);
    _exit(write(ends[1], answer.data(), answer.size()) == ssize_t(answer.size()) ? 0 : 1);
  }
  close(ends[1]);
  const std::string answer = said(ends[0]);
  close(ends[0]);
  int status = 0;
  rusage used{};
  wait4(child, &status, 0, &used);
  const std::chrono::duration<double, std::milli> wall = std::chrono::steady_clock::now() - start;
  const std::size_t tab = answer.find('\t');
  const bool is_whole = status == 0 && tab != std::string::npos;
  return fmt::format("{}\t{}\t{:.1f}\t{:.1f}\t{}\t{}\n", is_whole ? answer.substr(0, tab) : "-1",
                     WIFSIGNALED(status) ? WTERMSIG(status) : WEXITSTATUS(status),
                     milliseconds(used.ru_utime) + milliseconds(used.ru_stime), wall.count(),
                     used.ru_maxrss >> 10, is_whole ? answer.substr(tab + 1) : "");
}

}  // namespace
}  // namespace heliograph

int main(int count, char** arguments) {
  if (count != 3) return 64;
  const rlim_t memory_bytes = std::strtoull(arguments[1], nullptr, 10);
  const rlim_t cpu_seconds = std::strtoull(arguments[2], nullptr, 10);
  heliograph::end_picture_threads();
  heliograph::Files files;
  while (heliograph::read(files)) {
    const std::string line = heliograph::attempt(files, memory_bytes, cpu_seconds);
    std::fputs(line.c_str(), stdout);
    std::fflush(stdout);
  }
}
