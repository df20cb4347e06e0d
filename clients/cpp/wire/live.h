// RenderBatch and Stream: credits, tags, and frames out of raw replies. Behind Results and Live.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <queue>
#include <vector>

#include "heliograph/live.h"
#include "wire/assembly.h"
#include "wire/draft.h"
#include "wire/raw_stream.h"

namespace heliograph::client::wire {

/// Sends the next job when an item was answered, so that `credits` of them are under way.
class BatchCall {
 public:
  BatchCall(std::shared_ptr<SceneCore> scene, Jobs jobs, const BatchOptions& options);
  std::optional<Result> next();
  void close() { stream_.cancel(); }

 private:
  struct Item {
    std::uint64_t tag;  // the job's own
    Assembly assembly{};
    FinalFrames frames;
  };
  /// Sends the next job that can be sent, or else the end.
  void send_next(std::uint32_t credits);
  void take(const grpc::ByteBuffer& reply);
  Item& item_of(std::uint64_t number);
  void end(const v1::RenderBatchReply& reply);

  const std::shared_ptr<SceneCore> scene_;
  Jobs jobs_;
  RawStream stream_;
  std::map<std::uint64_t, Item> items_;  // by the number they were sent with
  std::uint64_t sent_ = 0;
  bool is_over_ = false;  // all were sent
  std::queue<Result> done_;
};

class LiveCall {
 public:
  LiveCall(std::shared_ptr<SceneCore> scene, std::vector<Ref> cameras, RenderOptions options,
           Policy policy, std::uint32_t credits);
  std::optional<Frame> next();
  /// The cameras stay where none are given.
  void update(const std::vector<Ref>* cameras, const RenderOptions& options);
  [[nodiscard]] RenderOptions options() const;
  void finish() { stream_.finish_sending(); }
  void close() { stream_.cancel(); }

 private:
  [[nodiscard]] v1::RenderRequest settings() const;

  const std::shared_ptr<SceneCore> scene_;
  const Policy policy_;
  mutable std::mutex mutex_;
  std::vector<Ref> cameras_;
  RenderOptions options_;
  RawStream stream_;
  Assembly assembly_;
  bool has_frame_ = false;  // whose credit next() gives back
};

}  // namespace heliograph::client::wire
