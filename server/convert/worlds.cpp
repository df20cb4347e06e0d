// Worlds: how many, which, their poses, their overlays.
#include "server/convert/worlds.h"

#include <fmt/format.h>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/limits.h"
#include "server/convert/nouns.h"
#include "server/convert/resolve.h"

namespace heliograph::server {
namespace {

Expected<u32> read_count(u64 count, u64 most) {
  if (count == 0) return fail(Code::kInvalidArgument, "", "is 0; say how many worlds there are");
  if (count <= most) return u32(count);
  Error error{.code = Code::kResourceExhausted,
              .message = fmt::format("is {}; {} are allowed: send several requests (limit worlds)",
                                     count, most),
              .where = ""};
  error.limit = "worlds";
  error.needed = count;
  error.available = most;
  return std::unexpected(std::move(error));
}

Status read_poses_of(const v1::WorldPoses& message, const Snapshot& scene, ArraySource& source,
                     Worlds& worlds) {
  HELIO_TAKE(worlds.entities, resolve_entities(message.entities(), scene), "entities");
  if (worlds.entities.empty())
    return fail(Code::kInvalidArgument, "entities", "is empty; leave poses out");
  const Dims dims{{"N", worlds.count}, {"M", worlds.entities.size()}, kFour, kFour};
  HELIO_TAKE(worlds.poses, read_poses(message.matrices(), source, dims), "matrices");
  worlds.teleport = message.teleport();
  return {};
}

Expected<std::vector<u32>> read_mask(const v1::Worlds& message, ArraySource& source) {
  std::vector<u32> rendered;
  ArrayOf<u8> mask;
  if (message.has_mask()) {
    auto raw = read_integers<u8>(message.mask(), source, {{"N", message.count()}}, v1::D_TYPE_U8);
    if (!raw) return std::unexpected(std::move(raw).error());
    mask = *std::move(raw);
  }
  for (u32 i = 0; i < message.count(); ++i)
    if (mask.empty() || mask[i] != 0) rendered.push_back(i);
  if (rendered.empty())
    return fail(Code::kInvalidArgument, "", "selects no world; set one, or leave the mask out");
  return rendered;
}

}  // namespace

Expected<Worlds> to_worlds(const v1::Worlds& message, const Snapshot& scene, ArraySource& source,
                           const WorldLimits& limits) {
  Worlds worlds;
  HELIO_TAKE(worlds.count, read_count(message.count(), limits.worlds), "count");
  if (u32(message.overlays_size()) > worlds.count)
    return fail(Code::kInvalidArgument, "overlays",
                fmt::format("has {} entries for {} worlds; give at most one each",
                            message.overlays_size(), worlds.count));
  if (message.has_poses())
    HELIO_CHECK(read_poses_of(message.poses(), scene, source, worlds), "poses");
  for (int i = 0; i < message.overlays_size(); ++i) {
    const std::string field = indexed("overlays", u64(i));
    HELIO_CHECK(check_count(message.overlays(i), limits.edits), field);
    HELIO_TAKE(worlds.overlays.emplace_back(), to_transaction(message.overlays(i), source), field);
  }
  HELIO_TAKE(worlds.rendered, read_mask(message, source), "mask");
  return worlds;
}

}  // namespace heliograph::server
