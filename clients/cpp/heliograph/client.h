// connect(), launch() and Client: a session with a daemon, and its scenes.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/scene.h"

namespace heliograph::client {

namespace wire {
class Session;
}

/// State of the journal: kWriting if durable scenes take edits.
enum class Journal : int {
  kUnknown = 0,
  kNone = 1,      // there is no --state-dir, so there are none
  kWriting = 2,   // they do
  kReadOnly = 3,  // not until the daemon can write again
};

struct ServerInfo {
  std::string version;
  std::uint32_t min_api = 1;  // the versions of the contract, heliograph.vN, that it speaks
  std::uint32_t max_api = 1;
  std::string backend;
  std::string cpu_features;
  std::uint32_t threads = 0;
  std::vector<std::string> capabilities{};
  std::vector<std::string> refused{};             // features the kernel refused, and effects
  std::map<std::string, std::uint64_t> limits{};  // in force for this client's tenant
  std::map<std::string, std::uint64_t> used{};    // use of them by the tenant
  std::string tenant{};
  double weight = 1;   // the tenant's share of the device against others'
  bool ready = false;  // a pixel was rendered
  Journal journal = Journal::kUnknown;
  std::string journal_reason{};  // why it is read-only
};

/// A session with a daemon. Copies are the same session; it ends, with its private scenes and a
/// private daemon, when the last of them and the last scene are gone, or by close(). Thread: any.
/// Do not fork() without exec(): the child has no session.
class Client {
 public:
  explicit Client(std::shared_ptr<wire::Session> session) : session_(std::move(session)) {}

  /// An empty scene.
  Scene create_scene(const std::string& name = "", Lifetime lifetime = Lifetime::kSession);
  /// A scene by its name; kNotFound lists the nearest.
  Scene open_scene(const std::string& name);
  /// A new scene from a file that Scene::save, of any client, wrote.
  Scene load_scene(const std::string& path, const std::string& name = "",
                   Lifetime lifetime = Lifetime::kSession);
  /// Lists every scene that this client may open.
  std::vector<Scene> scenes();
  [[nodiscard]] ServerInfo info() const;

  [[nodiscard]] const std::string& address() const;  // "unix:///path" or "host:port"
  /// Ends the session and a private daemon now. Safe to call twice.
  void close();

 private:
  std::shared_ptr<wire::Session> session_;
};

/// Encryption and certificates of TCP: paths of PEM files, read when the client connects.
struct Tls {
  std::string ca{};    // who signed the daemon's certificate; "": whom the system trusts
  std::string cert{};  // this client's own, with its key, for a daemon that demands one
  std::string key{};
  std::string server_name{};  // the name in the daemon's certificate, where the address has another
};

/// Called before each call, in its thread, for the headers of W3C Trace Context, {"traceparent",
/// ...} and perhaps "tracestate", which the daemon's log and the frames' manifests then name. Edits
/// go over streams, which have the trace of the moment when they began. Empty: none.
using TraceHeaders = std::function<std::map<std::string, std::string>()>;

struct ConnectOptions {
  std::string token{};  // who this client is
  std::optional<Tls> tls{};
  double timeout = 10;  // seconds that connecting may take
  TraceHeaders trace{};
};

/// A daemon that runs: "unix:///run/heliograph.sock" (Linux), or "node7:7443".
Client connect(const std::string& address, const ConnectOptions& options = {});
Client connect(const std::string& address, const std::string& token);

struct LaunchOptions {
  std::vector<std::string> arguments{};  // more flags of heliographd
  std::string program{};                 // default: $HELIOGRAPHD, then heliographd on PATH
  double timeout = 30;                   // seconds that it may take to start and to connect
  std::function<void(const std::string&)>
      log{};  // gets each line of its log, in a thread of its own
  TraceHeaders trace{};
};

/// Starts a private daemon, which ends with this client, or with this process however that ends.
/// Linux 5.3 and later.
Client launch(const LaunchOptions& options = {});

}  // namespace heliograph::client
