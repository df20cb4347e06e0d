// Replies kept to answer retries: a call that was done is answered again, never done twice.
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

/// How many replies are kept, and how many bytes of them.
struct ReplyLimits {
  u64 replies = 1024;
  u64 bytes = 16ull << 20;
};

/// The calls of one session that carry a request_id. Failures are not kept: they did nothing.
/// Thread: any.
class RequestLog {
 public:
  /// charge   of its tenant's bytes, for the replies that are kept
  explicit RequestLog(ReplyLimits limits, Charge charge = {})
      : limits_(limits), charge_(std::move(charge)) {}

  /// A serialised reply when the call was done; nothing when it is new, and then finish() must
  /// follow. ABORTED while the first one runs, INVALID_ARGUMENT when another method used the id.
  [[nodiscard]] Expected<std::optional<std::string>> begin(const std::string& id,
                                                           const std::string& method);
  /// nullopt: the call failed.
  void finish(const std::string& id, std::optional<std::string> reply);
  /// A call that was done by a daemon before this one.
  void restore(const std::string& id, const std::string& method, std::string reply);

 private:
  struct Entry {
    std::string method;
    std::optional<std::string> reply;  // nothing while it runs
  };
  void forget_oldest();  // under mutex_

  const ReplyLimits limits_;
  std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::deque<std::string> done_;  // oldest first
  u64 bytes_ = 0;
  Charge charge_;
};

/// Whether a reply settles what became of an edit; one with retry_seconds says that nothing did.
[[nodiscard]] bool is_kept(const Expected<v1::ApplyReply>& reply);

/// The numbered edits of one session in one scene. Thread: any; edits are begun in its strand.
class EditLog : public std::enable_shared_from_this<EditLog> {
 public:
  using Reply = std::shared_ptr<const Expected<v1::ApplyReply>>;
  using Done = std::function<void(const Reply&)>;
  /// Ends an edit with its reply, from any thread. After one that is not kept the number is free
  /// again, and so are those after it, which end the same way.
  using Finish = std::function<void(Expected<v1::ApplyReply>)>;
  /// What survives the daemon: the replies that are kept.
  struct State {
    u64 last = 0;  // the number of the last reply
    std::vector<Reply> kept;
  };

  /// charge   of its tenant's bytes, for the replies that are kept
  EditLog(std::shared_ptr<Strand> strand, ReplyLimits limits, Charge charge)
      : strand_(std::move(strand)), limits_(limits), charge_(std::move(charge)) {}

  [[nodiscard]] Strand& strand() { return *strand_; }
  /// The number the next edit must carry.
  [[nodiscard]] u64 next() const;
  /// Calls apply(finish) for number last + 1, and `done` with the reply when it is there; refusals
  /// are kept too. Answers an older number with its reply. ABORTED with `expected` for a gap, or
  /// for a number that is no longer kept; INVALID_ARGUMENT for 0.
  void answer(u64 number, const std::function<void(Finish)>& apply, const Done& done);

  /// Edits that are not done yet are left out.
  [[nodiscard]] State state() const;
  void restore(State state);

 private:
  struct Edit {
    Reply reply;  // null: not done
    std::vector<Done> waiting;
  };
  using EditPtr = std::shared_ptr<Edit>;
  void finish(const EditPtr& edit, Expected<v1::ApplyReply> reply);
  // Both under mutex_.
  void keep(const Reply& reply);
  bool forget_oldest();  // false: it is the last one, or not done

  std::shared_ptr<Strand> strand_;
  const ReplyLimits limits_;
  mutable std::mutex mutex_;
  u64 last_ = 0;
  std::deque<EditPtr> kept_;  // the last is number last_
  u64 bytes_ = 0;
  Charge charge_;
};

}  // namespace heliograph::server
