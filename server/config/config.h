// Configuration from the command line and the settings file. Parsed once by main, const from then
// on.
#pragma once

#include <sys/types.h>

#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Exit statuses of the process.
enum ExitCode : int {
  kExitOk = 0,            // drained, or the owner ended
  kExitNotHealthy = 1,    // --probe: it does not serve
  kExitUsage = 64,        // a flag or setting is wrong, or would not be safe
  kExitData = 65,         // the state directory is damaged
  kExitUnavailable = 69,  // cannot listen, or another daemon does
  kExitSoftware = 70,     // a bug, or a library failed
  kExitDevice = 75,       // the device was lost
};

// X(name, default, what it bounds): every limit is a setting, --limit NAME=VALUE.
#define HELIO_LIMITS(X)                                                                       \
  X(connections, 256, "open connections, a quarter of them Unix socket only")                 \
  X(connections_per_peer, 64, "connections per process, over TCP per address")                \
  X(metrics_connections, 32, "connections to the metrics port")                               \
  X(metrics_connections_per_peer, 8, "connections to it per address")                         \
  X(sessions, 256, "open sessions")                                                           \
  X(calls_per_session, 64, "concurrent calls and streams per session")                        \
  X(quick_calls, 256, "sessions with a socket for quick calls")                               \
  X(streams_per_connection, 64, "concurrent calls and streams per connection")                \
  X(pool_queue, 8192, "requests waiting for a thread; half of it for one tenant")             \
  X(client_bytes, 256, "bytes of a client's name for itself")                                 \
  X(log_bytes, 1ull << 20, "bytes of queued log lines")                                       \
  X(log_value_bytes, 1024, "bytes per value in the log")                                      \
  X(slow_call_seconds, 5, "seconds after which the log warns of a call")                      \
  X(slow_render_seconds, 60, "the same for calls that use the device or decoder")             \
  X(overload_sessions, 85, "percent of bytes or memory in use: no new sessions")              \
  X(overload_uploads, 92, "the same: no uploads and decodes")                                 \
  X(overload_jobs, 97, "the same: no render jobs and queries")                                \
  X(memory_bytes, 1ull << 50, "bytes of the daemon's memory, at most what exists")            \
  X(jobs, 256, "render jobs and queries, waiting or running")                                 \
  X(descriptors, 65'536, "descriptors of frames in shared memory and of quick calls")         \
  X(reserved_parts, 8, "each tenant's reserved share of every total: 1 / this")               \
  X(scenes, 4096, "scenes, private and shared")                                               \
  X(revisions, 64, "recent revisions kept per scene")                                         \
  X(entities, 4'000'000, "entities per scene")                                                \
  X(array_bytes, 8ull << 30, "bytes of all arrays per scene")                                 \
  X(message_bytes, 16ull << 20, "bytes of a request message")                                 \
  X(chunk_bytes, 1ull << 20, "bytes of one chunk of an upload or a frame")                    \
  X(blob_bytes, 4ull << 30, "bytes of one uploaded blob")                                     \
  X(upload_window_bytes, 16ull << 20, "bytes of an upload charged ahead of arrival")          \
  X(blob_store_bytes, 16ull << 30, "bytes of all blobs and assets")                           \
  X(recent_seconds, 30, "seconds for which an upload or asset is kept without a use")         \
  X(recent_bytes, 128ull << 20, "bytes of used uploads and assets kept per session")          \
  X(frame_bytes, 4ull << 30, "bytes of all frames per request")                               \
  X(shared_bytes, 1ull << 30, "bytes of a session's shared buffers")                          \
  X(credits, 64, "frames or items per call, in work or in flight")                            \
  X(waiting_bytes, 64ull << 20, "bytes of waiting requests per call")                         \
  X(stall_seconds, 30, "seconds a reader may take nothing while data waits")                  \
  X(hang_seconds, 4, "seconds of a stall before the daemon is not ready")                     \
  X(stuck_seconds, 60, "seconds of a stall before the daemon is not live")                    \
  X(lost_seconds, 10, "seconds to recover a lost device before the daemon ends")              \
  X(probe_seconds, 5, "seconds between two probes, which render a pixel")                     \
  X(samples, 1ull << 20, "samples per pixel")                                                 \
  X(tenant_bytes, 16ull << 30, "bytes of a tenant's uploads, blobs, assets and arrays")       \
  X(tenant_entities, 64'000'000, "entities of all scenes per tenant")                         \
  X(tenant_streams, 256, "open Stream, RenderBatch and Watch calls per tenant")               \
  X(tenant_jobs, 256, "render jobs and queries per tenant, waiting or running")               \
  X(tenant_disk_bytes, 16ull << 30, "bytes of durable scenes on the disk per tenant")         \
  X(tenant_edits_per_second, 1'000'000, "edits per second, averaged over 10 s")               \
  X(tenant_samples_per_second, 100'000'000'000, "samples of all pixels per second, same")     \
  X(groups, 64, "light groups per request")                                                   \
  X(worlds, 4096, "worlds per request")                                                       \
  X(edits, 1'000'000, "edits per transaction")                                                \
  X(replies, 1024, "replies kept per session and scene, for retries")                         \
  X(resume_seconds, 600, "seconds after the start to resume sessions in")                     \
  X(snapshot_edits, 100'000, "edits of durable scenes between two snapshots")                 \
  X(snapshot_bytes, 64ull << 20, "bytes of these edits, or of the scenes if more")            \
  X(journal_queue, 65'536, "edits waiting for the disk per tenant")                           \
  X(disk_reserve_bytes, 16ull << 20, "bytes of disk kept for deletions on a full disk")       \
  X(disk_spare_bytes, 1ull << 30, "bytes of disk left to tenants that use little")            \
  X(saved_bytes, 16ull << 30, "bytes of other scenes saved when the device is lost")          \
  X(save_seconds, 120, "seconds that saving them may take")                                   \
  X(reply_bytes, 16ull << 20, "bytes of replies kept per session and scene, and per session") \
  X(watch_events, 16'384, "newest transactions kept per scene for Watch")                     \
  X(watch_bytes, 16ull << 20, "bytes of these transactions")                                  \
  X(quota_bytes, 256ull << 20, "bytes gRPC may buffer for the Unix socket")                   \
  X(tcp_quota_bytes, 256ull << 20, "bytes gRPC may buffer for TCP")                           \
  X(derived_bytes, 4ull << 30, "bytes of unused derived data, kept as a cache")               \
  X(static_triangles, 4'000'000, "triangles of static entities traced as one mesh")           \
  X(query_items, 1u << 20, "rays, pixels, points or pairs per query")                         \
  X(track_times, 256, "times per call of Tracks")                                             \
  X(record_bytes, 1ull << 30, "bytes of a recording, or of all in its folder")                \
  X(decode_bytes, 2ull << 30, "address space of a decoder process")                           \
  X(decode_result_bytes, 1ull << 30, "bytes of a decoder's result")                           \
  X(decode_texels, 1ull << 27, "texels per decoded picture")                                  \
  X(decode_vertices, 1ull << 26, "vertices per decoded mesh")                                 \
  X(decode_triangles, 1ull << 27, "triangles per decoded mesh")                               \
  X(decode_entities, 1ull << 20, "entities per decoded model")                                \
  X(decode_keys, 1ull << 22, "keys of all animations per decoded model")                      \
  X(decode_json_bytes, 64ull << 20, "bytes of a glTF document without its buffers")           \
  X(decode_seconds, 30, "seconds a file may take to decode")                                  \
  X(decodes, 4, "concurrent decoder processes")                                               \
  X(decodes_per_tenant, 3, "concurrent decoder processes per tenant")                         \
  X(decode_queue, 256, "waiting decodes per tenant")

struct Limits {
#define HELIO_LIMIT(name, value, text) u64 name = value;
  HELIO_LIMITS(HELIO_LIMIT)
#undef HELIO_LIMIT
};

struct Config {
  std::string socket;  // path of the Unix socket; the local channel is `socket`.fd.sock
  std::optional<gid_t> socket_group;  // its members may connect too
  std::vector<std::string> listen;    // TCP addresses
  std::string token_file;             // used with `listen` where there is no tenants_file
  std::string tenants_file;           // "": one tenant
  std::string tls_cert;               // PEM; "": TCP without TLS
  std::string tls_key;
  std::string tls_client_ca;  // "": clients need no certificate
  bool insecure = false;      // the operator knows
  bool is_private = false;
  int owner_pidfd = -1;
  int ready_fd = -1;
  u32 threads = 0;                  // threads that render; 0: see --threads
  u32 devices = 0;                  // 0: all
  u64 spread_samples = 16'000'000;  // of a picture, from which it spreads over devices
  u64 device_memory = 0;            // bytes per device; 0: nine tenths of its free memory
  std::string backend = "embree";
  std::string denoiser = "libOpenImageDenoise.so.2";
  std::string asset_root;                   // "": server_path is refused
  std::string decode_program;               // "": beside this program
  std::vector<std::string> decode_without;  // of the sandbox, where the kernel refuses it
  std::string state_dir;                    // "": no scene is durable
  double grace_seconds = 10;                // a session outlives its connection by this
  double drain_seconds = 20;                // in-flight work may take this long after SIGTERM
  std::string record;                       // file or folder of a recording; "": none
  std::string metrics;                      // address of the metrics' port; "": none
  bool reflection = false;
  std::string probe;  // "live", "ready" or "durable": ask the daemon at `socket` and exit
  std::string log_level = "warning";
  bool log_json = false;
  Limits limits;
  std::set<std::string> limits_set;  // names of limits that the operator set

  /// Returns true when others than this machine's users can read or use the traffic.
  [[nodiscard]] bool is_exposed() const;
};

/// A parsed --limit NAME=VALUE.
struct LimitSetting {
  u64 Limits::* limit;
  u64 value;
};

/// Parses the setting of a limit. INVALID_ARGUMENT, at --limit: no such limit, or the value is no
/// number above 0.
[[nodiscard]] Expected<LimitSetting> parse_limit(std::string_view name, std::string_view value);

/// Warning to clients and in the log when is_exposed().
inline constexpr const char* kExposed =
    "TLS: off at an address that others reach (--insecure-i-know); they can read tokens and "
    "pictures, and stall the daemon";

/// Parses the command line and the settings file it names. An int is an exit status: --help and
/// --version were printed, or the usage error was.
[[nodiscard]] std::expected<Config, int> parse_config(int argc, char** argv);

/// Returns the limits by name, as GetServerInfo reports them.
[[nodiscard]] std::vector<std::pair<std::string, u64>> list_limits(const Limits& limits);

/// Returns the path of the local channel.
[[nodiscard]] std::string local_channel_path(const std::string& socket);

}  // namespace heliograph::server
