#include "wire/live.h"

#include <utility>

#include "wire/convert.h"

namespace heliograph::client::wire {
namespace {

void refuse(bool is_given, const std::string& name, const std::string& why) {
  if (is_given) throw ClientError(Code::kInvalidArgument, name + ": " + why, {name});
}

void check_job(const RenderOptions::Fields& given) {
  const std::string why = "is of the whole batch, not of a job; leave it out";
  refuse(bool(given.progress), "progress", why);
  refuse(bool(given.on_pass), "on_pass", why);
  refuse(bool(given.timeout), "timeout", why);
  refuse(bool(given.cancellation), "cancellation", why);
}

void check_live(const RenderOptions::Fields& given) {
  refuse(bool(given.progress), "progress", "is not for a stream; leave it out");
  refuse(bool(given.on_pass), "on_pass", "is not for a stream; leave it out");
}

CallOptions call_options(const RenderOptions::Fields& given) {
  return {given.timeout, given.cancellation};
}

struct BatchPixels {
  std::uint64_t number = 0;
  Span span;
};

/// Destination of the pixels of a RenderBatchReply that holds a chunk of bytes: its item and span;
/// the cursor stands before the bytes. RenderBatchReply has tag 1, part 2.
std::optional<BatchPixels> batch_pixels(Cursor& cursor) {
  BatchPixels out;
  for (std::uint64_t tag = cursor.varint(); tag == 0x08; tag = cursor.varint()) {
    out.number = cursor.varint();
    if (cursor.byte() != 0x12) return std::nullopt;
    cursor.varint();
    const auto span = chunk_span(cursor);
    if (!span) return std::nullopt;
    out.span = *span;
    return out;
  }
  return std::nullopt;
}

}  // namespace

// ---------------------------------------------------------------- BatchCall

BatchCall::BatchCall(std::shared_ptr<SceneCore> scene, Jobs jobs, const BatchOptions& options)
    : scene_(std::move(scene)),
      jobs_(std::move(jobs)),
      stream_(scene_->session, "RenderBatch", {options.timeout, options.cancellation}) {
  refuse(options.credits == 0, "credits", "is 0; at least 1 is needed");
  for (std::uint32_t i = 0; i < options.credits && !is_over_; ++i)
    send_next(sent_ == 0 ? options.credits : 0);
}

void BatchCall::send_next(std::uint32_t credits) {
  while (auto job = jobs_()) {
    v1::RenderBatchRequest request;
    try {
      check_job(job->options.fields());
      *request.mutable_job() =
          to_request(scene_->session->server(), scene_->id, job->cameras, job->options);
    } catch (const ClientError& error) {
      done_.push({job->tag, {}, error});
      continue;
    }
    request.set_tag(++sent_);
    request.set_credits(credits);
    items_.emplace(sent_, Item{job->tag, {}, FinalFrames(job->cameras.size())});
    return stream_.send(request);
  }
  is_over_ = true;
  stream_.finish_sending();
}

std::optional<Result> BatchCall::next() {
  while (done_.empty()) {
    grpc::ByteBuffer reply;
    if (!stream_.read(&reply)) return std::nullopt;
    take(reply);
  }
  Result out = std::move(done_.front());
  done_.pop();
  return out;
}

BatchCall::Item& BatchCall::item_of(std::uint64_t number) {
  const auto found = items_.find(number);
  if (found == items_.end()) throw broken("an item that was not asked for");
  return found->second;
}

void BatchCall::take(const grpc::ByteBuffer& reply) {
  Cursor cursor(reply);
  if (const auto pixels = batch_pixels(cursor)) {
    Item& item = item_of(pixels->number);
    if (auto arrived = item.assembly.add_pixels(cursor, pixels->span))
      item.frames.add(std::move(*arrived));
    return;
  }
  const auto message = parsed<v1::RenderBatchReply>(reply);
  if (message.done()) return end(message);
  Item& item = item_of(message.tag());
  if (auto arrived = item.assembly.add_part(message.part())) item.frames.add(std::move(*arrived));
}

void BatchCall::end(const v1::RenderBatchReply& reply) {
  Item& item = item_of(reply.tag());
  Result result{item.tag, {}, {}};
  if (reply.status().code() != 0)
    result.error = to_error(reply.status());
  else
    result.frames = item.frames.take();
  items_.erase(reply.tag());
  done_.push(std::move(result));
  if (!is_over_) send_next(1);
}

// ---------------------------------------------------------------- LiveCall

LiveCall::LiveCall(std::shared_ptr<SceneCore> scene, std::vector<Ref> cameras,
                   RenderOptions options, Policy policy, std::uint32_t credits)
    : scene_(std::move(scene)),
      policy_(policy),
      cameras_(std::move(cameras)),
      options_(std::move(options)),
      stream_(scene_->session, "Stream", call_options(options_.fields())) {
  refuse(credits == 0, "credits", "is 0; at least 1 is needed");
  v1::StreamRequest request;
  *request.mutable_settings() = settings();
  request.set_credits(credits);
  request.set_policy(policy == Policy::kLatest ? v1::StreamRequest::POLICY_LATEST
                                               : v1::StreamRequest::POLICY_LOSSLESS);
  stream_.send(request);
}

v1::RenderRequest LiveCall::settings() const {
  check_live(options_.fields());
  v1::RenderRequest out = to_request(scene_->session->server(), scene_->id, cameras_, options_);
  out.set_progressive(policy_ == Policy::kLatest);
  return out;
}

std::optional<Frame> LiveCall::next() {
  if (std::exchange(has_frame_, false)) {
    v1::StreamRequest request;
    request.set_credits(1);
    stream_.send(request);
  }
  for (grpc::ByteBuffer part; stream_.read(&part); part.Clear()) {
    auto arrived = assembly_.add(part);
    if (!arrived) continue;
    has_frame_ = true;
    return std::move(arrived->frame);
  }
  return std::nullopt;
}

void LiveCall::update(const std::vector<Ref>* cameras, const RenderOptions& options) {
  const std::lock_guard lock(mutex_);
  if (cameras) cameras_ = *cameras;
  options_ = options;
  v1::StreamRequest request;
  *request.mutable_settings() = settings();
  stream_.send(request);
}

RenderOptions LiveCall::options() const {
  const std::lock_guard lock(mutex_);
  return options_;
}

}  // namespace heliograph::client::wire
