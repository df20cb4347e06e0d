#include "server/decode/result.h"

#include <fmt/format.h>

#include <cmath>
#include <map>

#include "server/convert/transaction.h"
#include "server/decode/decoded.pb.h"

namespace heliograph::server {
namespace {

/// Arrays of the region; the same range is the same buffer.
class RegionSource : public ArraySource {
 public:
  explicit RegionSource(std::shared_ptr<const Region> region) : region_(std::move(region)) {}

  Expected<BufferPtr> bytes(const v1::Array& array) override {
    const v1::BufferRef& range = array.buffer();
    const auto found = region_->data(range.offset(), range.size());
    if (!array.has_buffer() || !found || range.offset() % 64 != 0) {
      return fail(Code::kInvalidArgument, "buffer", "leaves the result");
    }
    BufferPtr& buffer = buffers_[{range.offset(), range.size()}];
    if (!buffer) buffer = std::make_shared<const Buffer>(region_, *found);
    return buffer;
  }
  Expected<std::shared_ptr<const Asset>> asset(std::string_view) override {
    return fail(Code::kNotFound, "", "an asset does not refer to others");
  }

 private:
  std::shared_ptr<const Region> region_;
  std::map<std::pair<u64, u64>, BufferPtr> buffers_;
};

/// Whether a reference stays within the asset: nothing, or an object made before `limit`.
bool within(const Ref& ref, u64 limit) {
  if (std::holds_alternative<std::monostate>(ref)) return true;
  const auto* created = std::get_if<CreatedByEdit>(&ref);
  return created && created->edit < limit;
}
bool within(const std::optional<Ref>& ref, u64 limit) { return !ref || within(*ref, limit); }
bool within(const std::optional<TextureUsePatch>& use, u64 limit) {
  return !use || within(use->texture, limit);
}

struct RefsWithin {
  u64 limit;

  bool operator()(const PutEntity& put) const {
    bool all = within(put.parent, limit) && within(put.mesh, limit) && within(put.volume, limit);
    if (put.materials) {
      for (const Ref& ref : *put.materials) all = all && within(ref, limit);
    }
    if (put.light && *put.light) {
      const LightPatch& light = **put.light;
      all = all && within(light.texture.texture, limit) && within(light.profile, limit);
    }
    if (put.skin && *put.skin) {
      for (const Ref& ref : (*put.skin)->joints) all = all && within(ref, limit);
    }
    return all;
  }
  bool operator()(const PutMaterial& put) const {
    bool all = true;
#define HELIO_MAP(name) all = all && within(put.name, limit);
    HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
    for (const ParameterPatch& parameter : put.parameters) {
      all = all && within(parameter.texture, limit);
    }
    return all;
  }
  bool operator()(const PutMesh&) const { return true; }
  bool operator()(const PutTexture&) const { return true; }
  bool operator()(const PutVolume&) const { return true; }
  template <class T>
  bool operator()(const T&) const {
    return false;
  }
};

std::unexpected<Error> broken(std::string what) {
  return fail(Code::kInternal, "result", "the decoder's result is broken: " + std::move(what));
}

/// Only puts, library before entities, named by themselves, referring backwards and nowhere else.
Status check_edits(const std::vector<Edit>& edits, u64 first, bool entities) {
  for (std::size_t i = 0; i < edits.size(); ++i) {
    const bool is_entity = std::holds_alternative<PutEntity>(edits[i].action);
    const bool named = std::holds_alternative<std::string>(edits[i].target) ||
                       std::holds_alternative<std::monostate>(edits[i].target);
    if (!named || is_entity != entities || !std::visit(RefsWithin{first + i}, edits[i].action)) {
      return broken(fmt::format("{}[{}]", entities ? "entities" : "library", i));
    }
  }
  return {};
}

Expected<std::vector<Edit>> read_edits(const v1::Transaction& message, ArraySource& source) {
  auto transaction = to_transaction(message, source);
  if (!transaction) return broken(transaction.error().where + " " + transaction.error().message);
  return std::move(transaction->edits);
}

Expected<Asset::Channel> read_channel(const decode::Channel& message, std::size_t entities,
                                      ArraySource& source) {
  if (message.entity() >= entities) return broken("a channel moves no entity");
  Asset::Channel channel{.entity = message.entity(), .keys = {}};
  if (message.has_pose()) {
    auto pose = to_pose(message.pose(), source);
    if (!pose) return broken(pose.error().where + " " + pose.error().message);
    channel.keys = std::move(*pose);
  } else {
    auto weights = to_morph_weights(message.morph_weights(), source);
    if (!weights) return broken(weights.error().where + " " + weights.error().message);
    channel.keys = std::move(*weights);
  }
  return channel;
}

Expected<std::shared_ptr<const Asset>> read_asset(const decode::Result& result,
                                                  const DecodeJob& job, ArraySource& source) {
  auto asset = std::make_shared<Asset>();
  asset->hash = job.hash;
  asset->name = result.name();
  auto library = read_edits(result.library(), source);
  if (!library) return std::unexpected(std::move(library).error());
  auto entities = read_edits(result.entities(), source);
  if (!entities) return std::unexpected(std::move(entities).error());
  HELIO_TRY(check_edits(*library, 0, false));
  HELIO_TRY(check_edits(*entities, library->size(), true));
  asset->library = std::move(*library);
  asset->entities = std::move(*entities);
  for (const decode::Animation& animation : result.animations()) {
    Asset::Animation& out = asset->animations.emplace_back();
    out.name = animation.name();
    for (const decode::Channel& channel : animation.channels()) {
      auto keys = read_channel(channel, asset->entities.size(), source);
      if (!keys) return std::unexpected(std::move(keys).error());
      out.channels.push_back(std::move(*keys));
    }
  }
  return asset;
}

Code code_of(u32 code) {
  switch (Code(code)) {
    case Code::kInvalidArgument:
    case Code::kUnimplemented:
    case Code::kResourceExhausted:
      return Code(code);
    default:
      return Code::kInternal;
  }
}

}  // namespace

Expected<Decoded> read_result(const std::shared_ptr<const Region>& region, const DecodeJob& job) {
  decode::Result result;
  const Bytes message = region->message();
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
  RegionSource source(region);
  if (result.has_texels()) {
    auto image = to_image(result.texels(), source);
    if (!image) return broken(image.error().where + " " + image.error().message);
    decoded.image = std::move(*image);
    decoded.image_srgb = result.srgb();
  } else if (result.missing().empty()) {
    auto asset = read_asset(result, job, source);
    if (!asset) return std::unexpected(std::move(asset).error());
    decoded.asset = std::move(*asset);
  }
  return decoded;
}

}  // namespace heliograph::server
