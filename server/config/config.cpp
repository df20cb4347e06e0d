// Parses flags and settings file into a Config. Called by main.
#include "server/config/config.h"

#include <fmt/ranges.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <charconv>
#include <cstdlib>

#include "renderer/device/backend.h"
#include "server/config/config_file.h"
#include "server/config/version.h"
#include "server/decode/decoder.h"
#include "server/os/accept.h"

namespace heliograph::server {
namespace {

std::string default_socket() {
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  const std::string folder = runtime != nullptr && *runtime == '/'
                                 ? std::string(runtime) + "/heliograph"
                                 : fmt::format("/tmp/heliograph-{}", ::geteuid());
  return folder + "/heliograph.sock";
}

Status set_limit(Config& config, const std::string& setting) {
  const auto equals = setting.find('=');
  if (equals == std::string::npos)
    return fail(Code::kInvalidArgument, "--limit", "'" + setting + "' is not NAME=NUMBER");
  const std::string_view view = setting;
  const auto parsed = parse_limit(view.substr(0, equals), view.substr(equals + 1));
  if (!parsed) return std::unexpected(parsed.error());
  config.limits.*parsed->limit = parsed->value;
  config.limits_set.insert(setting.substr(0, equals));
  return {};
}

std::string limits_help() {
  std::string text = "Limits (--limit NAME=VALUE):\n";
#define HELIO_LIMIT(name, value, what) \
  text += fmt::format("  {:<24} {} [{}]\n", #name, what, u64(value));
  HELIO_LIMITS(HELIO_LIMIT)
#undef HELIO_LIMIT
  return text +
         "Exit status: 0 drained or the owner ended, 1 --probe found it not healthy, 64 a wrong or "
         "unsafe flag or setting, 65 a damaged state directory, 69 cannot listen, 70 internal "
         "error, 75 device lost.";
}

/// Checks that keys, identities and addresses go together.
Status check_security(const Config& config) {
  for (const std::string& address : config.listen)
    if (auto checked = is_loopback(address); !checked) return std::unexpected(checked.error());
  if (!config.tenants_file.empty() && !config.token_file.empty())
    return fail(Code::kInvalidArgument, "--token-file", "goes without --tenants, which lists them");
  if (config.is_private && !(config.listen.empty() && config.tenants_file.empty()))
    return fail(Code::kInvalidArgument, "--private",
                "goes without --listen and --tenants: it serves one process on its socket");
  if (config.tls_cert.empty() != config.tls_key.empty())
    return fail(Code::kInvalidArgument, "--tls-cert, --tls-key", "go together");
  if (!config.tls_cert.empty() && config.listen.empty())
    return fail(Code::kInvalidArgument, "--tls-cert", "is for TCP; say where with --listen");
  if (!config.tls_client_ca.empty() && (config.tls_cert.empty() || config.tenants_file.empty()))
    return fail(Code::kInvalidArgument, "--tls-client-ca",
                "needs --tls-cert and --tls-key, and --tenants, which says whose certificate is "
                "whose");
  if (!config.is_exposed() || config.insecure) return {};
  return fail(Code::kInvalidArgument, "--listen",
              "others reach this address, so it needs --tls-cert and --tls-key; or listen on "
              "127.0.0.1 and go through `ssh -L`. --insecure-i-know does without: anybody on the "
              "network can then read tokens, scenes and pictures, and stall the daemon");
}

Status check(const Config& config) {
  const auto backends = backend_names();
  if (std::ranges::find(backends, config.backend) == backends.end())
    return fail(Code::kInvalidArgument, "--backend",
                fmt::format("there is no backend '{}'; choose one of: {}", config.backend,
                            fmt::join(backends, ", ")));
  if (config.grace_seconds < 0 || config.drain_seconds < 0)
    return fail(Code::kInvalidArgument, "--grace, --drain", "must not be negative");
  if (config.is_private && config.socket_group)
    return fail(Code::kInvalidArgument, "--socket-group", "a private daemon serves its owner only");
  if (config.owner_pidfd >= 0 && !config.is_private)
    return fail(Code::kInvalidArgument, "--owner-pidfd", "needs --private");
  return {};
}

void add_flags(CLI::App& app, Config& config) {
  app.add_option("--socket", config.socket, "Path of the Unix socket (mode 0600)");
  app.add_option("--listen", config.listen, "TCP address too, e.g. 127.0.0.1:7443");
  app.add_option("--token-file", config.token_file,
                 "Token that TCP clients send; made with mode 0600 when it is not there");
  app.add_option("--tenants", config.tenants_file,
                 "File of tenants with their tokens and certificates (docs/operations.md); instead "
                 "of --token-file");
  app.add_option("--tls-cert", config.tls_cert, "Certificate chain of TCP, PEM");
  app.add_option("--tls-key", config.tls_key, "Its private key, PEM, mode 0600");
  app.add_option("--tls-client-ca", config.tls_client_ca,
                 "PEM of those who sign clients' certificates, which are demanded then");
  app.add_flag("--insecure-i-know", config.insecure, "Listen where others reach it without TLS");
  app.add_flag("--private", config.is_private, "Serve one owner process and end with it");
  app.add_option("--owner-pidfd", config.owner_pidfd, "Inherited pidfd of the owner");
  app.add_option("--ready-fd", config.ready_fd,
                 "Inherited descriptor that gets one line of JSON when connections are taken");
  app.add_option(
         "--threads", config.threads,
         "Render threads; 0: as many as there are cores (or the container's quota makes), of 8 "
         "or more one less")
      ->capture_default_str();
  app.add_option("--backend", config.backend, "Render backend")->capture_default_str();
  app.add_option("--devices", config.devices,
                 "GPUs to render on, the first ones that the driver shows; 0: all")
      ->capture_default_str();
  app.add_option("--spread-samples", config.spread_samples,
                 "A picture of as many samples, over all pixels, is rendered by all GPUs that have "
                 "nothing else to do")
      ->capture_default_str();
  app.add_option("--device-memory", config.device_memory,
                 "Bytes that are used of each GPU's memory; 0: nine tenths of what is free at the "
                 "start")
      ->capture_default_str();
  app.add_option("--denoiser", config.denoiser,
                 "Open Image Denoise 2: a path, a name the loader finds, or off")
      ->capture_default_str();
  app.add_option("--asset-root", config.asset_root,
                 "Folder beneath which DecodeAsset may read server_path; off by default");
  app.add_option("--decode-program", config.decode_program,
                 "heliograph-decode; default: beside this program");
  app.add_option("--decode-without", config.decode_without,
                 "Layers of the decoder's sandbox that it may do without where the kernel or "
                 "container refuses them: landlock, namespaces")
      ->delimiter(',')
      ->check(
          CLI::IsMember(std::vector<std::string>(kOptionalLayers.begin(), kOptionalLayers.end())));
  app.add_option("--state-dir", config.state_dir,
                 "Folder of durable scenes, made if need be; without it no scene is durable");
  app.add_option("--grace", config.grace_seconds,
                 "Seconds a session outlives its connection (private daemon: 0)")
      ->capture_default_str();
  app.add_option("--drain", config.drain_seconds, "Seconds in-flight work may take after SIGTERM")
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "debug, info, warning, error or off")
      ->check(CLI::IsMember({"debug", "info", "warning", "error", "off"}))
      ->capture_default_str();
  app.add_flag("--log-json", config.log_json, "Log JSON lines");
  app.add_option("--metrics", config.metrics,
                 "Address of a port for Prometheus, e.g. 127.0.0.1:9464; off by default");
  app.add_option(
      "--record", config.record,
      "Record what clients ask in a file, or in a folder, a new file each start; scripts/replay "
      "plays it");
  app.add_flag("--reflection", config.reflection, "Tell callers the protocol's descriptors");
  app.add_option(
         "--probe", config.probe,
         "Ask the daemon at --socket whether it is live, is ready, or takes edits of durable "
         "scenes, and exit with 0 or 1")
      ->check(CLI::IsMember({"live", "ready", "durable"}))
      ->configurable(false);
}

/// Flags that do not map to a member of Config.
struct Extra {
  std::string socket_dir;
  std::string socket_group;
  std::vector<std::string> file_limits, limits;
};

void add_extra_flags(CLI::App& app, Extra& extra) {
  app.add_option("--socket-dir", extra.socket_dir, "Folder of the sockets, instead of --socket");
  app.add_option("--socket-group", extra.socket_group,
                 "Group whose members may connect too (then mode 0660): a name or a number");
  app.add_option("--limit", extra.limits, "NAME=VALUE, see below")->configurable(false);
  app.set_config("--config", "", "Settings file (TOML); flags go before it", false);
  app.config_formatter(std::make_shared<ConfigFile>(app, extra.file_limits));
}

Status complete(const CLI::App& app, const Extra& extra, Config& config) {
  if (config.socket.empty())
    config.socket =
        extra.socket_dir.empty() ? default_socket() : extra.socket_dir + "/heliograph.sock";
  HELIO_TRY(check_security(config));
  if (config.token_file.empty())
    config.token_file = config.socket.substr(0, config.socket.rfind('/') + 1) + "token";
  if (config.is_private && app.count("--grace") == 0) config.grace_seconds = 0;
  if (!extra.socket_group.empty()) {
    const auto group = find_group(extra.socket_group);
    if (!group) return std::unexpected(group.error());
    config.socket_group = *group;
  }
  for (const auto* limits : {&extra.file_limits, &extra.limits})  // flags win
    for (const std::string& limit : *limits) HELIO_TRY(set_limit(config, limit));
  return check(config);
}

}  // namespace

std::expected<Config, int> parse_config(int argc, char** argv) {
  Config config;
  Extra extra;
  CLI::App app("heliographd: the render daemon of Heliograph", "heliographd");
  app.set_version_flag("--version", kVersion);
  app.footer(limits_help());
  add_flags(app, config);
  add_extra_flags(app, extra);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return std::unexpected(app.exit(error) == 0 ? kExitOk : kExitUsage);
  }
  const Status status = complete(app, extra, config);
  if (status) return config;
  fmt::print(stderr, "heliographd: {}: {}\n", status.error().where, status.error().message);
  return std::unexpected(kExitUsage);
}

bool Config::is_exposed() const {
  return tls_cert.empty() && std::ranges::any_of(listen, [](const std::string& address) {
           return !is_loopback(address).value_or(false);
         });
}

Expected<LimitSetting> parse_limit(std::string_view name, std::string_view value) {
  LimitSetting setting{.limit = nullptr, .value = 0};
#define HELIO_LIMIT(field, ...) \
  if (name == #field) setting.limit = &Limits::field;
  HELIO_LIMITS(HELIO_LIMIT)
#undef HELIO_LIMIT
  if (setting.limit == nullptr)
    return fail(Code::kInvalidArgument, "--limit",
                fmt::format("there is no limit '{}'; --help lists them", name));
  const char* end = value.data() + value.size();
  const auto parsed = std::from_chars(value.data(), end, setting.value);
  if (parsed.ec == std::errc() && parsed.ptr == end && setting.value > 0) return setting;
  return fail(Code::kInvalidArgument, "--limit",
              fmt::format("{} needs a number above 0, not '{}'", name, value));
}

std::vector<std::pair<std::string, u64>> list_limits(const Limits& limits) {
  return {
#define HELIO_LIMIT(name, ...) {#name, limits.name},
      HELIO_LIMITS(HELIO_LIMIT)
#undef HELIO_LIMIT
  };
}

std::string local_channel_path(const std::string& socket) { return socket + ".fd.sock"; }

}  // namespace heliograph::server
