// Replies kept to answer retries: a call that was done is answered again, never done twice.
#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "heliograph/v1/service.pb.h"
#include "renderer/base/error.h"
#include "server/work_pool.h"

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
  explicit RequestLog(ReplyLimits limits) : limits_(limits) {}

  /// A serialised reply when the call was done; nothing when it is new, and then finish() must
  /// follow. ABORTED while the first one runs, INVALID_ARGUMENT when another method used the id.
  [[nodiscard]] Expected<std::optional<std::string>> begin(const std::string& id,
                                                           const std::string& method);
  /// nullopt: the call failed.
  void finish(const std::string& id, std::optional<std::string> reply);

 private:
  struct Entry {
    std::string method;
    std::optional<std::string> reply;  // nothing while it runs
  };
  const ReplyLimits limits_;
  std::mutex mutex_;
  std::map<std::string, Entry> entries_;
  std::deque<std::string> done_;  // oldest first
  u64 bytes_ = 0;
};

/// The numbered edits of one session in one scene. Thread: tasks of its strand, but for next().
class EditLog {
 public:
  using Reply = std::shared_ptr<const Expected<v1::ApplyReply>>;

  EditLog(WorkPool& pool, ReplyLimits limits, u32 queue)
      : strand_(std::make_shared<Strand>(pool, queue)), limits_(limits) {}

  [[nodiscard]] Strand& strand() { return *strand_; }
  /// The number the next edit must carry.
  [[nodiscard]] u64 next() const { return last_ + 1; }
  /// Does number last + 1 and keeps its reply, refusals included; answers an older number with its
  /// reply. ABORTED with `expected` for a gap, or for a number that is no longer kept.
  [[nodiscard]] Reply answer(u64 number, const std::function<Expected<v1::ApplyReply>()>& apply);

 private:
  std::shared_ptr<Strand> strand_;
  const ReplyLimits limits_;
  std::atomic<u64> last_ = 0;
  std::deque<Reply> kept_;  // the last is number last_
  u64 bytes_ = 0;
};

}  // namespace heliograph::server
