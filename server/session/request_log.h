// Replies kept to answer retries: a repeated call gets its earlier reply and is never executed
// twice.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/base/error.h"
#include "server/os/work_pool.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Limits of kept replies: count and bytes.
struct ReplyLimits {
  u64 replies = 1024;
  u64 bytes = 16ull << 20;
};

/// The calls of one session that carry a request_id. Failures are not kept: they changed nothing.
/// Thread: any.
class RequestLog {
 public:
  /// charge   of the tenant's bytes, for kept replies
  explicit RequestLog(ReplyLimits limits, Charge charge = {})
      : limits_(limits), charge_(std::move(charge)) {}

  /// Begins a call. Returns the serialised reply when it was done before; none when it is new, and
  /// then finish() must follow. ABORTED while the first one runs, INVALID_ARGUMENT when another
  /// method used the id.
  [[nodiscard]] Expected<std::optional<std::string>> begin(const std::string& id,
                                                           const std::string& method);
  /// Ends a call. reply: nullopt when it failed.
  void finish(const std::string& id, std::optional<std::string> reply);
  /// Restores a call that an earlier daemon executed.
  void restore(const std::string& id, const std::string& method, std::string reply);

 private:
  struct Entry {
    std::string method;
    std::optional<std::string> reply;  // none while it runs
  };
  void forget_oldest();  // under mutex_

  const ReplyLimits limits_;
  std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::deque<std::string> done_;  // oldest first
  u64 bytes_ = 0;
  Charge charge_;
};

/// Returns true when a reply is final: a refusal with retry_seconds leaves the number free.
[[nodiscard]] bool is_kept(const Expected<v1::ApplyReply>& reply);

/// The numbered edits of one session in one scene. Thread: any; edits begin in its strand.
class EditLog : public std::enable_shared_from_this<EditLog> {
 public:
  using Reply = std::shared_ptr<const Expected<v1::ApplyReply>>;
  using Done = std::function<void(const Reply&)>;
  /// Ends an edit with its reply. Thread: any. A reply that is not kept frees the number again, and
  /// those of later edits, which end with the same reply.
  using Finish = std::function<void(Expected<v1::ApplyReply>)>;
  /// State that survives the daemon: the kept replies.
  struct State {
    u64 last = 0;  // the number of the last reply
    std::vector<Reply> kept;
  };

  /// charge   of the tenant's bytes, for kept replies
  EditLog(std::shared_ptr<Strand> strand, ReplyLimits limits, Charge charge)
      : strand_(std::move(strand)), limits_(limits), charge_(std::move(charge)) {}

  [[nodiscard]] Strand& strand() { return *strand_; }
  /// Returns the number that the next edit must carry.
  [[nodiscard]] u64 next() const;
  /// Executes or answers an edit: calls apply(finish) for number last + 1, and `done` with the
  /// reply once it exists; refusals are kept too. Answers an older number with its kept reply.
  /// ABORTED with `expected` for a gap, or for a number whose reply is no longer kept;
  /// INVALID_ARGUMENT for 0.
  void answer(u64 number, const std::function<void(Finish)>& apply, const Done& done);

  /// Returns the state, without unfinished edits.
  [[nodiscard]] State state() const;
  void restore(State state);

 private:
  struct Edit {
    Reply reply;  // null: not done yet
    std::vector<Done> waiting;
  };
  using EditPtr = std::shared_ptr<Edit>;
  void finish(const EditPtr& edit, Expected<v1::ApplyReply> reply);
  // Both under mutex_.
  void keep(const Reply& reply);
  bool forget_oldest();  // false: it is the last one, or unfinished

  std::shared_ptr<Strand> strand_;
  const ReplyLimits limits_;
  mutable std::mutex mutex_;
  u64 last_ = 0;
  std::deque<EditPtr> kept_;  // the last is number last_
  u64 bytes_ = 0;
  Charge charge_;
};

}  // namespace heliograph::server
