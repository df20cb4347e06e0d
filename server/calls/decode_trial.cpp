#include "server/calls/decode_trial.h"

#include <filesystem>

namespace heliograph::server {
namespace {

constexpr auto kRetry = std::chrono::seconds(5);

void on_tried(Daemon& daemon, const Status& status) {
  daemon.health.decoder(status);
  if (!status) return daemon.loop->after(kRetry, [&daemon] { try_decoder(daemon); });
  for (const std::string& refused : (*daemon.decoder)->state().refused)
    daemon.log.warning("files are decoded without a layer of the sandbox (--decode-without)",
                       {{"layer", refused}});
}

}  // namespace

DecoderOptions decoder_options(const Config& config) {
  const auto beside = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  return {.program = config.decode_program.empty() ? (beside / "heliograph-decode").string()
                                                   : config.decode_program,
          .memory_bytes = config.limits.decode_bytes,
          .cpu_seconds = u32(config.limits.decode_seconds),
          .deadline_seconds = double(config.limits.decode_seconds),
          .limits = {.bytes = config.limits.decode_result_bytes,
                     .texels = config.limits.decode_texels,
                     .vertices = config.limits.decode_vertices,
                     .triangles = config.limits.decode_triangles,
                     .entities = config.limits.decode_entities,
                     .keys = config.limits.decode_keys,
                     .json_bytes = config.limits.decode_json_bytes},
          .without = config.decode_without,
          .processes = config.limits.decodes,
          .tenant_processes = config.limits.decodes_per_tenant,
          .tenant_waiting = config.limits.decode_queue};
}

void try_decoder(Daemon& daemon) {
  if (!daemon.decoder) return on_tried(daemon, std::unexpected(daemon.decoder.error()));
  (*daemon.decoder)->try_out([&daemon](const Status& status) {
    daemon.loop->post([&daemon, status] { on_tried(daemon, status); });
  });
}

}  // namespace heliograph::server
