// Watch: a stream of changes that is begun again where it was cut off. Behind client::Watch.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>

#include "heliograph/watch.h"
#include "wire/draft.h"
#include "wire/raw_stream.h"

namespace heliograph::client::wire {

class WatchCall {
 public:
  /// Returns once the daemon watches.
  WatchCall(std::shared_ptr<SceneCore> scene, const WatchOptions& options);
  std::optional<Change> next();
  [[nodiscard]] std::uint64_t revision() const { return revision_; }
  void close();

 private:
  /// 0: the next one.
  void open(std::uint64_t first);
  /// Opens the stream again, trying while the daemon cannot be reached.
  void resume(std::uint64_t first);
  v1::WatchReply read();
  [[nodiscard]] bool may_retry(const ClientError& error) const;

  const std::shared_ptr<SceneCore> scene_;
  const WatchOptions options_;
  const Cancellation ending_;
  std::optional<RawStream> stream_;  // the reader's
  std::atomic<std::uint64_t> revision_{0};
  std::atomic<bool> is_closed_{false};
};

}  // namespace heliograph::client::wire
