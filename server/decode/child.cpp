#include "server/decode/child.h"

#include <map>

#include "renderer/assets/load.h"
#include "server/convert/transaction.h"
#include "server/decode/asset.h"

namespace heliograph::server {
namespace {

/// Assigns every distinct buffer an offset in the data section.
class Arrays {
 public:
  void place(const BufferPtr& buffer, v1::Array& array) {
    const Bytes bytes = buffer->bytes();
    const auto [at, is_new] = offsets_.try_emplace(buffer->serial(), aligned(end_));
    if (is_new) {
      end_ = at->second + bytes.size();
      kept_.push_back(buffer);
      spans_.push_back(bytes);
    }
    array.mutable_buffer()->set_offset(at->second);
    array.mutable_buffer()->set_size(bytes.size());
  }
  [[nodiscard]] std::span<const Bytes> spans() const { return spans_; }
  [[nodiscard]] u64 size() const { return end_; }

 private:
  std::map<u64, u64> offsets_;  // by serial
  std::vector<BufferPtr> kept_;
  std::vector<Bytes> spans_;
  u64 end_ = 0;
};

decode::Result refusal(const Error& error) {
  decode::Result result;
  result.set_code(u32(error.code));
  result.set_message(error.message);
  result.set_where(error.where);
  result.set_needed(error.needed);
  result.set_available(error.available);
  return result;
}

decode::Result to_result(const Loaded& loaded, const ArraySink& sink) {
  decode::Result result;
  for (const std::string& path : loaded.missing) result.add_missing(path);
  for (const std::string& warning : loaded.warnings) result.add_warnings(warning);
  for (const vec3& corner : {loaded.bounds_min, loaded.bounds_max}) {
    for (int i = 0; i < 3; ++i) result.add_bounds(corner[i]);
  }
  if (loaded.image) {
    *result.mutable_texels() = to_proto(*loaded.image, sink);
    result.set_srgb(loaded.image_srgb);
  }
  write_asset(loaded.asset, result, sink);
  return result;
}

/// Requests room for a result. False: the daemon is gone or refuses.
[[nodiscard]] bool ask_for(u64 bytes) {
  if (!send_packet(kSocket, PacketKind::kNeed,
                   {reinterpret_cast<const char*>(&bytes), sizeof bytes}))
    return false;
  const auto answer = receive_packet(kSocket);
  return answer && *answer && (*answer)->kind == PacketKind::kGrant;
}

void send_result(const decode::Result& result, std::span<const Bytes> arrays) {
  if (!ask_for(region_size(result, arrays))) return;
  if (fill_region(kResultRegion, result, arrays)) (void)send_packet(kSocket, PacketKind::kResult);
}

LoadLimits limits_of(const decode::Limits& message) {
  return {.bytes = message.bytes(),
          .texels = message.texels(),
          .vertices = message.vertices(),
          .triangles = message.triangles(),
          .entities = message.entities(),
          .keys = message.keys(),
          .json_bytes = message.json_bytes()};
}

Expected<Loaded> load(const Region& region, Helpers& helpers, u64& result_bytes) {
  std::vector<Bytes> spans;
  Expected<decode::Job> job = read_job(region, spans);
  if (!job) return std::unexpected(std::move(job).error());
  result_bytes = job->limits().bytes();
  std::vector<BundleFile> files;
  for (std::size_t i = 0; i < spans.size(); ++i) files.push_back({job->paths(int(i)), spans[i]});
  return load_asset(files, {.format = job->format(),
                            .up = job->up(),
                            .units = job->units(),
                            .layer = job->layer(),
                            .variant = job->variant(),
                            .surface = job->surface(),
                            .limits = limits_of(job->limits()),
                            .in_threads = [&](const auto& work) { helpers.run(work); }});
}

}  // namespace

Expected<decode::Job> read_job(const Region& region, std::vector<Bytes>& files) {
  decode::Job job;
  const Bytes message = region.message();
  if (!job.ParseFromArray(message.data(), int(message.size())) ||
      job.paths_size() != job.sizes_size()) {
    return fail(Code::kInternal, "", "the job cannot be read");
  }
  u64 end = 0;
  for (const u64 size : job.sizes()) {
    const auto bytes = region.data(aligned(end), size);
    if (!bytes) return fail(Code::kInternal, "", "a file leaves the job");
    files.push_back(*bytes);
    end = aligned(end) + size;
  }
  return job;
}

void run_job(const Region& job, Helpers& helpers) {
  u64 result_bytes = 0;
  const Expected<Loaded> loaded = load(job, helpers, result_bytes);
  if (!loaded) return send_result(refusal(loaded.error()), {});
  Arrays arrays;
  const decode::Result result = to_result(
      *loaded, [&](const BufferPtr& buffer, v1::Array& array) { arrays.place(buffer, array); });
  if (arrays.size() > result_bytes) {
    Error error{.code = Code::kResourceExhausted,
                .message =
                    "the decoded arrays are larger than a result may be "
                    "(limit decode_result_bytes)",
                .where = ""};
    error.limit = "decode_result_bytes";
    error.needed = arrays.size();
    error.available = result_bytes;
    return send_result(refusal(error), {});
  }
  send_result(result, arrays.spans());
}

}  // namespace heliograph::server
