// Writes a decoded model to a message, and reads it back with everything checked: the decode child
// is not trusted.
#include "server/decode/asset.h"

#include <fmt/format.h>

namespace heliograph::server {

std::unexpected<Error> broken(std::string what) {
  return fail(Code::kInternal, "result", "the decoder's result is broken: " + std::move(what));
}

namespace {

/// Returns true when a reference stays within the asset: none, or an object made before `limit`.
bool within(const Ref& ref, u64 limit) {
  if (std::holds_alternative<std::monostate>(ref)) return true;
  const auto* created = std::get_if<CreatedByEdit>(&ref);
  return created && created->edit < limit;
}
bool within(const std::optional<Ref>& ref, u64 limit) { return !ref || within(*ref, limit); }
bool within(const Boxed<Ref>& ref, u64 limit) { return !ref || within(*ref, limit); }
bool within(const Boxed<TextureUsePatch>& use, u64 limit) {
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

/// Checks edits: only puts, library before entities, self-named, references only backwards.
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

}  // namespace

Expected<std::shared_ptr<const Asset>> read_asset(const decode::Result& result,
                                                  const std::string& hash, ArraySource& source) {
  auto asset = std::make_shared<Asset>();
  asset->hash = hash;
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

void write_asset(const Asset& asset, decode::Result& result, const ArraySink& sink) {
  result.set_name(asset.name);
  *result.mutable_library() = to_proto(Transaction{asset.library}, sink);
  *result.mutable_entities() = to_proto(Transaction{asset.entities}, sink);
  for (const Asset::Animation& animation : asset.animations) {
    decode::Animation* out = result.add_animations();
    out->set_name(animation.name);
    for (const Asset::Channel& channel : animation.channels) {
      decode::Channel* track = out->add_channels();
      track->set_entity(channel.entity);
      if (const auto* pose = std::get_if<PosePatch>(&channel.keys)) {
        *track->mutable_pose() = to_proto(*pose, sink);
      } else {
        *track->mutable_morph_weights() = to_proto(std::get<MorphWeights>(channel.keys), sink);
      }
    }
  }
}

}  // namespace heliograph::server
