// See state.h.
#include "server/journal/state.h"

#include "server/convert/export.h"
#include "server/convert/scene_file.h"
#include "server/os/hash.h"

namespace heliograph::server {
namespace {

void add_ids(const TableIds& ids, journal::Numbers& out) {
  journal::Ids* added = out.add_ids();
  added->mutable_versions()->Add(ids.versions.begin(), ids.versions.end());
  added->mutable_order()->Add(ids.order.begin(), ids.order.end());
}

journal::Numbers to_proto(const SceneNumbers& numbers) {
  journal::Numbers out;
  out.set_revision(numbers.revision);
  out.set_advances(numbers.advances);
  out.set_next_label(numbers.next_label);
  for (const TableIds* ids : {&numbers.entities, &numbers.meshes, &numbers.materials,
                              &numbers.textures, &numbers.volumes})
    add_ids(*ids, out);
  out.mutable_without_label()->Add(numbers.without_label.begin(), numbers.without_label.end());
  return out;
}

Expected<SceneNumbers> from_proto(const journal::Numbers& message) {
  SceneNumbers numbers{.revision = message.revision(),
                       .advances = message.advances(),
                       .next_label = message.next_label()};
  TableIds* all[] = {&numbers.entities, &numbers.meshes, &numbers.materials, &numbers.textures,
                     &numbers.volumes};
  if (std::size_t(message.ids_size()) != std::size(all))
    return fail(Code::kInvalidArgument, "numbers.ids", "are not of five kinds");
  for (int i = 0; i < message.ids_size(); ++i) {
    const journal::Ids& ids = message.ids(i);
    all[i]->versions.assign(ids.versions().begin(), ids.versions().end());
    all[i]->order.assign(ids.order().begin(), ids.order().end());
  }
  numbers.without_label.assign(message.without_label().begin(), message.without_label().end());
  return numbers;
}

journal::Log to_proto(const LogState& state) {
  journal::Log log;
  log.set_session(state.session);
  log.set_last(state.edits.last);
  for (const EditLog::Reply& reply : state.edits.kept) {
    if (*reply)
      *log.add_replies()->mutable_applied() = **reply;
    else
      *log.add_replies()->mutable_refusal() = encode_refusal(reply->error());
  }
  return log;
}

}  // namespace

Expected<std::vector<BlobFilePtr>> store_state(SceneState& state, BlobFiles& files, Room room) {
  std::vector<BlobFilePtr> stored;
  Status status;
  const auto store = [&](const std::string& hash, std::span<const std::byte> bytes) {
    auto file = files.put(hash, bytes, room);
    if (file)
      stored.push_back(std::move(*file));
    else if (status)
      status = std::unexpected(std::move(file).error());
  };
  const auto sink = [&](const BufferPtr& bytes, v1::Array& array) {
    if (bytes->bytes().size() <= kLargestInline)
      return array.set_inline_(bytes->bytes().data(), bytes->bytes().size());
    array.set_blob(files.hash_of(bytes));
    store(array.blob(), bytes->bytes());
  };
  journal::State message;
  *message.mutable_scene() = scene_header(*state.head, sink);
  *message.mutable_numbers() = to_proto(numbers(*state.head));
  for (const LogState& log : state.logs) *message.add_logs() = to_proto(log);
  if (state.events)
    for (const auto& event : state.events->list(state.head->revision)) message.add_events(*event);
  std::string bytes;
  if (!message.SerializeToString(&bytes))
    return fail(Code::kResourceExhausted, "", "the scene's description is over 2 GiB");
  state.row.set_state(sha256(bytes));
  store(state.row.state(), std::as_bytes(std::span(bytes)));
  if (!status) return std::unexpected(std::move(status).error());
  return stored;
}

Expected<std::shared_ptr<const Snapshot>> decode_scene(journal::State& state, ArraySource& source,
                                                       const SceneLimits& limits) {
  auto description = to_description(std::move(*state.mutable_scene()), source);
  if (!description) return std::unexpected(std::move(description).error());
  state.clear_scene();
  auto numbers = from_proto(state.numbers());
  if (!numbers) return std::unexpected(std::move(numbers).error());
  return restore(*description, *numbers, limits);
}

LogState decode_log(const journal::Log& log) {
  LogState state{.session = log.session(), .edits = {.last = log.last(), .kept = {}}};
  for (const journal::Reply& reply : log.replies())
    state.edits.kept.push_back(std::make_shared<const Expected<v1::ApplyReply>>(
        reply.has_refusal()
            ? Expected<v1::ApplyReply>(std::unexpected(decode_refusal(reply.refusal())))
            : Expected<v1::ApplyReply>(reply.applied())));
  return state;
}

journal::Refusal encode_refusal(const Error& error) {
  journal::Refusal refusal;
  refusal.set_code(u32(error.code));
  refusal.set_message(error.message);
  journal::Refusal::Detail& detail = *refusal.mutable_detail();
  detail.set_field(error.where);
  detail.mutable_users()->Add(error.users.begin(), error.users.end());
  detail.mutable_nearest()->Add(error.nearest.begin(), error.nearest.end());
  detail.set_reason(error.reason);
  detail.set_limit(error.limit);
  detail.set_needed(error.needed);
  detail.set_available(error.available);
  detail.set_allowed(error.allowed);
  detail.set_expected(error.expected);
  detail.set_retry_seconds(error.retry_seconds);
  return refusal;
}

Error decode_refusal(const journal::Refusal& refusal) {
  const journal::Refusal::Detail& detail = refusal.detail();
  return {.code = Code(refusal.code()),
          .message = refusal.message(),
          .where = detail.field(),
          .users = {detail.users().begin(), detail.users().end()},
          .nearest = {detail.nearest().begin(), detail.nearest().end()},
          .reason = detail.reason(),
          .limit = detail.limit(),
          .needed = detail.needed(),
          .available = detail.available(),
          .allowed = detail.allowed(),
          .expected = detail.expected(),
          .retry_seconds = detail.retry_seconds()};
}

}  // namespace heliograph::server
