#include "server/decode/result.h"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "server/convert/transaction.h"
#include "server/decode/asset.h"

namespace heliograph::server {
namespace {

/// Arrays of the region; equal ranges give the same buffer.
class RegionSource : public ArraySource {
 public:
  RegionSource(std::shared_ptr<const Region> region, std::shared_ptr<const void> paid)
      : region_(std::move(region)),
        owner_(std::make_shared<const Owner>(region_, std::move(paid))) {}

  Expected<BufferPtr> bytes(const v1::Array& array) override {
    const v1::BufferRef& range = array.buffer();
    const auto found = region_->data(range.offset(), range.size());
    if (!array.has_buffer() || !found || range.offset() % 64 != 0) {
      return fail(Code::kInvalidArgument, "buffer", "leaves the result");
    }
    BufferPtr& buffer = buffers_[{range.offset(), range.size()}];
    if (!buffer) buffer = std::make_shared<const Buffer>(owner_, *found);
    return buffer;
  }
  Expected<std::shared_ptr<const Asset>> asset(std::string_view) override {
    return fail(Code::kNotFound, "", "an asset does not refer to others");
  }

 private:
  struct Owner {
    std::shared_ptr<const Region> region;
    std::shared_ptr<const void> paid;
  };
  const std::shared_ptr<const Region> region_;
  const std::shared_ptr<const Owner> owner_;
  std::map<std::pair<u64, u64>, BufferPtr> buffers_;
};

Code code_of(u32 code) {
  switch (Code(code)) {
    case Code::kInvalidArgument:
    case Code::kNotFound:
    case Code::kUnimplemented:
    case Code::kResourceExhausted:
      return Code(code);
    default:
      return Code::kInternal;
  }
}

}  // namespace

Expected<Decoded> read_result(const std::shared_ptr<const Region>& region, const DecodeJob& job,
                              std::shared_ptr<const void> paid) {
  decode::Result result;
  const Bytes message = region->message();
  if (message.size() > kMessageBytes) return broken("as large as no message");
  if (!result.ParseFromArray(message.data(), int(message.size()))) return broken("unreadable");
  if (result.code() != 0) {
    Error error{
        .code = code_of(result.code()), .message = result.message(), .where = result.where()};
    error.needed = result.needed();
    error.available = result.available();
    return std::unexpected(std::move(error));
  }
  Decoded decoded;
  decoded.bytes = region->size();
  decoded.missing = {result.missing().begin(), result.missing().end()};
  decoded.warnings = {result.warnings().begin(), result.warnings().end()};
  if (result.bounds_size() != 6) return broken("bounds");
  for (int i = 0; i < 6; ++i) {
    if (!std::isfinite(result.bounds(i))) return broken("bounds");
    (i < 3 ? decoded.bounds_min : decoded.bounds_max)[i % 3] = result.bounds(i);
  }
  RegionSource source(region, std::move(paid));
  if (result.has_texels()) {
    auto image = to_image(result.texels(), source);
    if (!image) return broken(image.error().where + " " + image.error().message);
    decoded.image = std::move(*image);
    decoded.image_srgb = result.srgb();
  } else if (result.missing().empty()) {
    auto asset = read_asset(result, job.hash, source);
    if (!asset) return std::unexpected(std::move(asset).error());
    decoded.asset = std::move(*asset);
  }
  return decoded;
}

}  // namespace heliograph::server
