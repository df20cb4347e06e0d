#include "wire/watch.h"

#include <cstring>
#include <numeric>
#include <utility>
#include <vector>

#include "wire/assembly.h"
#include "wire/session.h"

namespace heliograph::client::wire {
namespace {

std::vector<std::uint64_t> ids_in(const std::string& bytes) {
  std::vector<std::uint64_t> ids(bytes.size() / sizeof(std::uint64_t));
  std::memcpy(ids.data(), bytes.data(), ids.size() * sizeof(std::uint64_t));
  return ids;
}

AppliedEdit applied(const v1::Edit& edit) {
  AppliedEdit out{};
  out.name = edit.target().name();
  const auto* action = edit.GetReflection()->GetOneofFieldDescriptor(
      edit, v1::Edit::descriptor()->FindOneofByName("action"));
  if (action == nullptr) return out;
  out.action = action->name();
  const auto& put = edit.GetReflection()->GetMessage(edit, action);
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  put.GetReflection()->ListFields(put, &fields);
  for (const auto* field : fields) {
    if (field->name() != "clear") {
      out.fields.push_back(field->name());
      continue;
    }
    for (int i = 0; i < put.GetReflection()->FieldSize(put, field); ++i)
      out.fields.push_back(put.GetReflection()->GetRepeatedString(put, field, i));
  }
  return out;
}

Change to_change(const v1::WatchReply& reply) {
  Change out{reply.revision(), !reply.has_transaction(), {}};
  const auto& edits = reply.transaction().edits();
  const std::vector<std::uint64_t> ids = ids_in(reply.ids());
  auto further = std::size_t(edits.size());
  if (std::accumulate(reply.counts().begin(), reply.counts().end(), further) != ids.size() ||
      reply.counts_size() != edits.size())
    throw broken("a change whose ids do not fit");
  for (int i = 0; i < edits.size(); ++i) {
    AppliedEdit edit = applied(edits[i]);
    if (ids[std::size_t(i)] != 0) edit.ids.push_back(ids[std::size_t(i)]);
    for (std::uint32_t n = 0; n < reply.counts(i); ++n) edit.ids.push_back(ids[further++]);
    if (edits[i].has_poses()) edit.ids = ids_in(edits[i].poses().ids().inline_());
    if (edit.ids.empty() && edits[i].target().id() != 0) edit.ids.push_back(edits[i].target().id());
    out.edits.push_back(std::move(edit));
  }
  return out;
}

}  // namespace

WatchCall::WatchCall(std::shared_ptr<SceneCore> scene, const WatchOptions& options)
    : scene_(std::move(scene)), options_(options) {
  if (options.from_revision && *options.from_revision == 0)
    throw ClientError(Code::kInvalidArgument,
                      "from_revision: is 0; the first transaction makes revision 1",
                      {"from_revision"});
  resume(options.from_revision.value_or(0));
}

void WatchCall::open(std::uint64_t first) {
  v1::WatchRequest request;
  request.set_scene(scene_->id);
  request.set_from_revision(first);
  request.set_bookmark_seconds(options_.bookmark_seconds.value_or(0));
  stream_.emplace(scene_->session, "Watch", CallOptions{{}, ending_});
  stream_->send(request, true);
  revision_ = read().revision();
}

v1::WatchReply WatchCall::read() {
  grpc::ByteBuffer reply;
  if (!stream_->read(&reply)) throw ClientError(Code::kUnavailable, "the watch ended; ask again");
  return parsed<v1::WatchReply>(reply);
}

bool WatchCall::may_retry(const ClientError& error) const {
  const bool is_lost = error.code() == Code::kUnavailable && !error.details().exit_code;
  return is_lost && !scene_->session->is_closed();
}

void WatchCall::resume(std::uint64_t first) {
  for (Patience patience; !is_closed_;) {
    try {
      return open(first);
    } catch (const ClientError& error) {
      if (is_closed_) return;
      if (!may_retry(error) || !patience.wait()) throw;
    }
  }
}

std::optional<Change> WatchCall::next() {
  while (!is_closed_) {
    try {
      const v1::WatchReply reply = read();
      revision_ = reply.revision();
      if (reply.has_transaction() || options_.bookmark_seconds) return to_change(reply);
    } catch (const ClientError& error) {
      if (is_closed_) break;
      if (!may_retry(error)) throw;
      resume(revision_ + 1);
    }
  }
  return std::nullopt;
}

void WatchCall::close() {
  is_closed_ = true;
  ending_.cancel();
}

}  // namespace heliograph::client::wire
