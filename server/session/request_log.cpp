// Exactly-once bookkeeping. Called by the handlers of edits and of calls with a request_id.
#include "server/session/request_log.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/convert/limits.h"
#include "server/os/mutant.h"
#include "server/quota/credits.h"

namespace heliograph::server {
namespace {

u64 bytes_of(const Expected<v1::ApplyReply>& reply) {
  return reply ? reply->ByteSizeLong() : reply.error().message.size();
}

std::string why_not(u64 number, u64 next) {
  if (number == 0) return fmt::format("is 0; edits are numbered from 1: give {}", next);
  if (number > next)
    return fmt::format("edit {} leaves a gap: number {} is expected", number, next);
  return fmt::format(
      "the reply to edit {} is no longer kept; read the scene and go on with number {}", number,
      next);
}

/// Returns the refusal of a number that is neither the next one nor one with a kept reply.
EditLog::Reply refused(u64 number, u64 next) {
  Error error{.code = number == 0 ? Code::kInvalidArgument : Code::kAborted,
              .message = why_not(number, next),
              .where = "number"};
  if (error.code == Code::kAborted) error.reason = "STALE_EDIT";
  error.expected = next;
  return std::make_shared<const Expected<v1::ApplyReply>>(std::unexpected(std::move(error)));
}

}  // namespace

Expected<std::optional<std::string>> RequestLog::begin(const std::string& id,
                                                       const std::string& method) {
  if (id.empty()) return std::nullopt;
  HELIO_TRY(check_request_id(id));
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
  while (done_.size() > limits_.replies || bytes_ > limits_.bytes) forget_oldest();
  while (!charge_.resize(charged(bytes_)) && done_.size() > 1) forget_oldest();
}

void RequestLog::forget_oldest() {
  const auto oldest = entries_.find(done_.front());
  bytes_ -= oldest->first.size() + oldest->second.reply->size();
  entries_.erase(oldest);
  done_.pop_front();
}

void RequestLog::restore(const std::string& id, const std::string& method, std::string reply) {
  const auto known = begin(id, method);
  if (known && !*known) finish(id, std::move(reply));
}

bool is_kept(const Expected<v1::ApplyReply>& reply) {
  return reply || reply.error().retry_seconds == 0;
}

u64 EditLog::next() const {
  const std::lock_guard lock(mutex_);
  return last_ + 1;
}

void EditLog::answer(u64 number, const std::function<void(Finish)>& apply, const Done& done) {
  EditPtr edit;
  Reply known;
  {
    const std::lock_guard lock(mutex_);
    if (number == last_ + 1 || (has_bug("apply_twice") && number <= last_)) {
      edit = std::make_shared<Edit>();
      edit->waiting.push_back(done);
      kept_.push_back(edit);
      last_ = number;
    } else if (number > last_ || number + kept_.size() <= last_) {
      known = refused(number, last_ + 1);
    } else {
      const EditPtr& old = kept_[kept_.size() - 1 - (last_ - number)];
      known = old->reply;
      if (!known) old->waiting.push_back(done);
    }
  }
  if (known) done(known);
  if (!edit) return;
  apply([self = shared_from_this(), edit](Expected<v1::ApplyReply> reply) {
    self->finish(edit, std::move(reply));
  });
}

void EditLog::finish(const EditPtr& edit, Expected<v1::ApplyReply> made) {
  const auto reply = std::make_shared<const Expected<v1::ApplyReply>>(std::move(made));
  std::vector<Done> waiting;
  {
    const std::lock_guard lock(mutex_);
    waiting.swap(edit->waiting);
    if (is_kept(*reply)) {
      edit->reply = reply;
      keep(reply);
    } else if (const auto at = std::ranges::find(kept_, edit); at != kept_.end()) {
      last_ -= u64(kept_.end() - at);
      kept_.erase(at, kept_.end());
    }
  }
  for (const Done& done : waiting) done(reply);
}

void EditLog::keep(const Reply& reply) {
  bytes_ += bytes_of(*reply);
  while ((kept_.size() > limits_.replies || bytes_ > limits_.bytes) && forget_oldest()) continue;
  while (!charge_.resize(charged(bytes_)) && forget_oldest()) continue;
}

bool EditLog::forget_oldest() {
  if (kept_.size() < 2 || !kept_.front()->reply) return false;
  bytes_ -= bytes_of(*kept_.front()->reply);
  kept_.pop_front();
  return true;
}

EditLog::State EditLog::state() const {
  const std::lock_guard lock(mutex_);
  State state{.last = last_, .kept = {}};
  for (const EditPtr& edit : kept_) {
    if (!edit->reply) break;
    if (has_bug("lose_reply") && state.kept.size() > 10) continue;
    state.kept.push_back(edit->reply);
  }
  state.last -= kept_.size() - state.kept.size();
  return state;
}

void EditLog::restore(State state) {
  const std::lock_guard lock(mutex_);
  last_ = state.last;
  for (Reply& reply : state.kept) {
    kept_.push_back(std::make_shared<Edit>(std::move(reply), std::vector<Done>()));
    keep(kept_.back()->reply);
  }
}

}  // namespace heliograph::server
