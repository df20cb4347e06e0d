// Batches of jobs, and live pictures. Made by Scene::render_batch and Scene::stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "heliograph/error.h"
#include "heliograph/frame.h"
#include "heliograph/ref.h"
#include "heliograph/render.h"

namespace heliograph::client {

namespace wire {
class BatchCall;
class LiveCall;
}  // namespace wire

/// Iterates once over the values of a source's next(): `for (const Frame& frame : live)`.
template <class Source, class Item>
class OnePass {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = Item;
  using difference_type = std::ptrdiff_t;
  using pointer = const Item*;
  using reference = const Item&;

  OnePass() = default;  // the end
  explicit OnePass(Source* source) : source_(source), item_(source->next()) {}
  reference operator*() const { return *item_; }
  pointer operator->() const { return &*item_; }
  OnePass& operator++() {
    item_.reset();
    item_ = source_->next();
    return *this;
  }
  void operator++(int) { ++*this; }
  bool operator==(const OnePass& other) const { return bool(item_) == bool(other.item_); }
  bool operator!=(const OnePass& other) const { return !(*this == other); }

 private:
  Source* source_ = nullptr;
  std::optional<Item> item_{};
};

/// Item of Scene::render_batch. The options progress, on_pass, timeout and cancellation belong to
/// the whole batch and are refused here.
struct Job {
  std::vector<Ref> cameras;
  RenderOptions options{};
  std::uint64_t tag = 0;  // comes back with its Result
};

struct BatchOptions {
  std::uint32_t credits = 4;        // jobs that are under way at a time
  std::optional<double> timeout{};  // seconds, of the whole batch
  std::optional<Cancellation> cancellation{};
};

/// Result of a Job: its frames in the order of its cameras, or its error.
struct Result {
  std::uint64_t tag = 0;
  std::vector<Frame> frames{};
  std::optional<ClientError> error{};

  /// The first camera's; throws the error when there is one.
  [[nodiscard]] const Frame& frame() const;
};

/// Gives the jobs of a batch one by one, none at the end; called when the last Result was taken.
using Jobs = std::function<std::optional<Job>()>;

/// Results of a batch in the order in which its jobs are done. Copies are the same batch;
/// destroying the last one cancels the jobs under way. Thread: one takes, any may close().
class Results {
 public:
  using iterator = OnePass<Results, Result>;

  explicit Results(std::shared_ptr<wire::BatchCall> call) : call_(std::move(call)) {}
  /// Blocks until a job is done; none when all were.
  std::optional<Result> next();
  iterator begin() { return iterator(this); }
  iterator end() { return {}; }
  /// Cancels the jobs under way: next() throws kCancelled.
  void close();

 private:
  std::shared_ptr<wire::BatchCall> call_;
};

/// Policy of a live picture when something newer comes: kLatest refines frames (1, 2, 4, ...
/// samples) until then and drops old ones; kLossless gives the final frames of each update, in
/// order.
enum class Policy : int { kLatest, kLossless };

/// Frames of a scene as it changes, by any client's edits or by update(). info().revision is the
/// one that a frame shows, info().is_final is true once its refinement is over. Copies are the same
/// stream; destroying the last one ends it. Thread: one takes frames, any may call update(),
/// finish() and close().
class Live {
 public:
  using iterator = OnePass<Live, Frame>;

  explicit Live(std::shared_ptr<wire::LiveCall> call) : call_(std::move(call)) {}
  /// Blocks until there is a frame, and gives the last one's credit back; none after finish().
  std::optional<Frame> next();
  iterator begin() { return iterator(this); }
  iterator end() { return {}; }

  /// Changes the request from now on. Begin with options() to keep the rest: they replace all.
  void update(const RenderOptions& options);
  void update(const std::vector<Ref>& cameras, const RenderOptions& options);
  [[nodiscard]] RenderOptions options() const;
  /// Takes no more updates: the frames end with the last one asked for.
  void finish();
  /// Ends the stream at once: next() throws kCancelled.
  void close();

 private:
  std::shared_ptr<wire::LiveCall> call_;
};

}  // namespace heliograph::client
