// Exactly-once bookkeeping. Called by the handlers of edits and of calls with a request_id.
#include "server/request_log.h"

#include <fmt/format.h>

namespace heliograph::server {
namespace {

u64 bytes_of(const Expected<v1::ApplyReply>& reply) {
  return reply ? reply->ByteSizeLong() : reply.error().message.size();
}

EditLog::Reply gap(u64 number, u64 next) {
  Error error{
      .code = Code::kAborted,
      .message = number < next
                     ? fmt::format("the reply to edit {} is no longer kept; read the scene and go "
                                   "on with number {}",
                                   number, next)
                     : fmt::format("edit {} leaves a gap: number {} is expected", number, next),
      .where = "number"};
  error.expected = next;
  return std::make_shared<const Expected<v1::ApplyReply>>(std::unexpected(std::move(error)));
}

}  // namespace

Expected<std::optional<std::string>> RequestLog::begin(const std::string& id,
                                                       const std::string& method) {
  if (id.empty()) return std::nullopt;
  if (id.size() > 256)
    return fail(Code::kInvalidArgument, "request_id", "is longer than 256 bytes");
  const std::lock_guard lock(mutex_);
  const auto [entry, is_new] = entries_.try_emplace(id, Entry{method, std::nullopt});
  if (is_new) return std::nullopt;
  if (entry->second.method != method)
    return fail(Code::kInvalidArgument, "request_id",
                "was used by a call of " + entry->second.method + "; choose a new one");
  if (!entry->second.reply)
    return fail(Code::kAborted, "request_id", "the first call with this id still runs; retry");
  return entry->second.reply;
}

void RequestLog::finish(const std::string& id, std::optional<std::string> reply) {
  if (id.empty()) return;
  const std::lock_guard lock(mutex_);
  const auto entry = entries_.find(id);
  if (!reply) {
    entries_.erase(entry);
    return;
  }
  bytes_ += id.size() + reply->size();
  entry->second.reply = std::move(reply);
  done_.push_back(id);
  while (done_.size() > limits_.replies || bytes_ > limits_.bytes) {
    const auto oldest = entries_.find(done_.front());
    bytes_ -= oldest->first.size() + oldest->second.reply->size();
    entries_.erase(oldest);
    done_.pop_front();
  }
}

EditLog::Reply EditLog::answer(u64 number, const std::function<Expected<v1::ApplyReply>()>& apply) {
  const u64 last = last_;
  if (number != last + 1) {
    if (number > last || number + kept_.size() <= last) return gap(number, last + 1);
    return kept_[kept_.size() - 1 - (last - number)];
  }
  auto reply = std::make_shared<const Expected<v1::ApplyReply>>(apply());
  last_ = number;
  bytes_ += bytes_of(*reply);
  kept_.push_back(reply);
  while (kept_.size() > 1 && (kept_.size() > limits_.replies || bytes_ > limits_.bytes)) {
    bytes_ -= bytes_of(*kept_.front());
    kept_.pop_front();
  }
  return reply;
}

}  // namespace heliograph::server
