// Connecting: the timeout holds in each way to fail, folders of sockets may be odd.
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>

#include "fixture.h"

using namespace heliograph::client;

namespace {

namespace fs = std::filesystem;

/// A new folder, removed at the end.
struct Folder {
  fs::path path;
  Folder() {
    std::string name = "/tmp/hg-XXXXXX";
    path = ::mkdtemp(name.data());
  }
  ~Folder() { fs::remove_all(path); }
};

/// Sets a variable of the environment for a while.
struct Setting {
  std::string name, before;
  bool was_set;
  Setting(const std::string& of, const std::string& value) : name(of) {
    const char* old = std::getenv(of.c_str());
    was_set = old != nullptr;
    if (was_set) before = old;
    ::setenv(of.c_str(), value.c_str(), 1);
  }
  ~Setting() {
    if (was_set)
      ::setenv(name.c_str(), before.c_str(), 1);
    else
      ::unsetenv(name.c_str());
  }
};

/// A local channel that takes connections and sends nothing.
struct Silent {
  int fd = ::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
  explicit Silent(const std::string& path) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path.data(), path.size());
    REQUIRE(::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0);
    REQUIRE(::listen(fd, 1) == 0);
  }
  ~Silent() { ::close(fd); }
};

template <class Work>
ClientError refused_in_time(const Work& work) {
  const auto begin = std::chrono::steady_clock::now();
  const ClientError error = error_of(work);
  const std::chrono::duration<double> passed = std::chrono::steady_clock::now() - begin;
  CHECK(passed.count() < 1.5);
  CHECK(error.code() == Code::kUnavailable);
  return error;
}

}  // namespace

TEST_CASE("a socket that says nothing is refused in time") {
  const Folder folder;
  const std::string socket = folder.path / "s.sock";
  const Silent silent(socket + ".fd.sock");
  ConnectOptions options;
  options.timeout = 0.5;
  const auto error = refused_in_time([&] { (void)connect("unix://" + socket, options); });
  CHECK(contains(error.what(), "no answer in time"));
}

TEST_CASE("a port where nobody answers is refused in time") {
  ConnectOptions options;
  options.timeout = 0.5;
  const auto error = refused_in_time([&] { (void)connect("127.0.0.1:1", options); });
  CHECK(contains(error.what(), "timeout"));
}

TEST_CASE("a private daemon that never listens is killed in time, with what it started") {
  const Folder folder;
  const fs::path program = folder.path / "daemon";
  std::ofstream(program) << "#!/bin/bash\ntrap '' TERM\nsleep 60 &\necho $! > $0.pid\nwait\nwait\n";
  ::chmod(program.c_str(), 0700);
  LaunchOptions options;
  options.program = program;
  options.timeout = 0.5;
  const auto error = refused_in_time([&] { (void)launch(options); });
  CHECK(contains(error.what(), "timeout"));
  std::string pid;
  std::ifstream(program.string() + ".pid") >> pid;
  for (int i = 0; i < 200 && fs::exists("/proc/" + pid + "/exe"); ++i) ::usleep(10'000);
  CHECK_FALSE(fs::exists("/proc/" + pid + "/exe"));
}

TEST_CASE("calls carry the trace that the caller tells") {
  const std::string trace = "4bf92f3577b34da6a3ce929d0e0e4736";
  std::mutex mutex;
  std::string log;
  LaunchOptions options;
  options.arguments = {"--log-level", "debug", "--threads", "1"};
  options.log = [&](const std::string& line) {
    const std::lock_guard lock(mutex);
    log += line + "\n";
  };
  options.trace = [&] {
    return std::map<std::string, std::string>{
        {"traceparent", "00-" + trace + "-00f067aa0ba902b7-01"}, {"baggage", "secret=1"}};
  };
  {
    Client client = launch(options);
    (void)client.create_scene();
    client.close();
  }
  const std::lock_guard lock(mutex);
  const auto at = log.find("/CreateScene");
  REQUIRE(at != std::string::npos);
  CHECK(contains(log.substr(at, log.find('\n', at) - at), "trace_id=\"" + trace + "\""));
  CHECK_FALSE(contains(log, "baggage"));
}

TEST_CASE("a private daemon starts whatever the folder for temporary files is") {
  const Folder folder;
  const std::string odd = folder.path / "two words, größe";
  const std::string long_one = folder.path / std::string(120, 'x');
  fs::create_directory(odd);
  fs::create_directory(long_one);
  for (const char* name : {"XDG_RUNTIME_DIR", "TMPDIR"}) {
    for (const std::string& value : {odd, long_one, folder.path.string() + "/not there"}) {
      const Setting none("XDG_RUNTIME_DIR", "");
      const Setting setting(name, value);
      LaunchOptions options;
      options.arguments = {"--threads", "1"};
      const Client client = launch(options);
      CHECK(client.info().threads == 1);
      CHECK(client.address().find(value) == std::string::npos);  // another folder was found
    }
  }
}
