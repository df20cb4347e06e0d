// ApplyStream from the client's side, on a completion queue.
#include "wire/apply_lane.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>
#include <vector>

#include "wire/draft.h"

namespace heliograph::client::wire {
namespace {

constexpr std::size_t kAhead = 256;  // edits on their way; the daemon remembers 1,024 replies
constexpr int kCloseSeconds = 5;

enum Tag : std::intptr_t { kStart = 1, kRead, kWrite, kFinish };
void* tag_of(Tag tag) { return reinterpret_cast<void*>(tag); }

/// True for the codes of a broken connection, whatever broke it.
bool is_lost(const grpc::Status& status) {
  switch (status.error_code()) {
    case grpc::OK:  // the daemon ends its streams before it stops
    case grpc::UNAVAILABLE:
    case grpc::CANCELLED:
    case grpc::INTERNAL:
      return true;
    default:
      return false;
  }
}

void give_ids(const IdTarget& target, const v1::ApplyReply& reply, int edits) {
  std::vector<std::uint64_t> ids(reply.ids().size() / sizeof(std::uint64_t));
  std::memcpy(ids.data(), reply.ids().data(), ids.size() * sizeof(std::uint64_t));
  std::size_t first = std::size_t(target.edit);
  std::size_t last = first + 1;
  if (target.is_further) {
    if (target.edit >= reply.counts_size()) return;
    first = std::size_t(edits);
    for (int i = 0; i < target.edit; ++i) first += reply.counts(i);
    last = first + reply.counts(target.edit);
  }
  std::array<std::size_t, 8> next{};  // of each kind
  for (std::size_t i = first; i < std::min(last, ids.size()); ++i) {
    const auto kind = Kind(ids[i] >> 56);
    std::size_t& at = next[std::size_t(kind) & 7];
    for (; at < target.nodes.size(); ++at) {
      if (target.nodes[at].kind != kind) continue;
      if (const auto node = target.nodes[at].node.lock()) node->id = ids[i];
      ++at;
      break;
    }
  }
}

}  // namespace

struct ApplyLane::Stream {
  grpc::ClientContext context;
  grpc::CompletionQueue queue;
  std::unique_ptr<grpc::ClientAsyncReaderWriter<v1::ApplyRequest, v1::ApplyReply>> calls;
  v1::ApplyReply reply;
  grpc::Status status;
  std::uint64_t openings = 0;  // of the session, when it began
  bool is_started = false;
  bool is_writing = false;
  bool is_finished = false;

  ~Stream() {
    queue.Shutdown();
    void* tag = nullptr;
    for (bool ok = false; queue.Next(&tag, &ok);) {
    }
  }
};

ApplyLane::ApplyLane(Session& session) : session_(session) {}
ApplyLane::~ApplyLane() = default;

void ApplyLane::expect(std::uint64_t scene, std::uint64_t next) {
  const std::lock_guard lock(mutex_);
  next_.emplace(scene, next);
}

void ApplyLane::forget(std::uint64_t scene) {
  const std::lock_guard lock(mutex_);
  next_.erase(scene);
}

/// True while edits of this scene are under way: the next number is not known before their replies.
bool ApplyLane::is_waiting(std::uint64_t scene) const {
  return std::any_of(waiting_.begin(), waiting_.end(),
                     [&](const auto& edit) { return edit->request.scene() == scene; });
}

std::uint64_t ApplyLane::number_of(std::uint64_t scene) {
  const auto found = next_.find(scene);
  if (found != next_.end()) return found->second++;
  v1::DescribeSceneRequest request;
  request.set_scene(scene);
  const auto reply = session_.call(&Session::Stub::DescribeScene, request);
  next_[scene] = reply.scene().next_edit() + 1;
  return reply.scene().next_edit();
}

void ApplyLane::submit(const std::shared_ptr<PendingEdit>& edit) {
  Lock lock(mutex_);
  session_.check_open();
  while (waiting_.size() >= kAhead) step(lock);
  while (next_.count(edit->request.scene()) == 0 && is_waiting(edit->request.scene())) step(lock);
  edit->request.set_number(number_of(edit->request.scene()));
  waiting_.push_back(edit);
  if (!stream_ && !is_polled_) open();
  pump();
  while (sent_ < waiting_.size()) step(lock);
  // Takes completed events, so that the next write need not wait for this one.
  if (!is_polled_ && stream_) step(lock, std::chrono::system_clock::now());
}

void ApplyLane::wait(const PendingEdit& edit) {
  Lock lock(mutex_);
  while (!edit.is_done) step(lock);
}

void ApplyLane::close() {
  Lock lock(mutex_);
  const auto end = std::chrono::system_clock::now() + std::chrono::seconds(kCloseSeconds);
  while (!waiting_.empty() && std::chrono::system_clock::now() < end) step(lock, end);
  fail_all(ClientError(Code::kUnavailable, "this client is closed; connect() again"));
  while (is_polled_) changed_.wait(lock);
  if (!stream_) return;
  stream_->context.TryCancel();
  while (stream_) step(lock);
}

void ApplyLane::open() {
  auto stream = std::make_unique<Stream>();
  stream->openings = session_.openings();
  session_.authorize(stream->context);
  stream->calls = session_.stub().PrepareAsyncApplyStream(&stream->context, &stream->queue);
  stream->calls->StartCall(tag_of(kStart));
  stream_ = std::move(stream);
  sent_ = 0;
}

/// Starts the next write.
void ApplyLane::pump() {
  if (!stream_ || !stream_->is_started || stream_->is_writing || sent_ == waiting_.size()) return;
  stream_->is_writing = true;
  stream_->calls->Write(waiting_[sent_++]->request, tag_of(kWrite));
}

/// Takes one event, or waits until the thread that polls has taken one.
void ApplyLane::step(Lock& lock, std::optional<Time> until) {
  if (is_polled_) {
    if (until)
      changed_.wait_until(lock, *until);
    else
      changed_.wait(lock);
    return;
  }
  is_polled_ = true;
  lock.unlock();
  void* tag = nullptr;
  bool ok = false;
  bool got = true;
  if (until)
    got = stream_->queue.AsyncNext(&tag, &ok, *until) == grpc::CompletionQueue::GOT_EVENT;
  else
    stream_->queue.Next(&tag, &ok);
  lock.lock();
  if (got) handle(tag, ok);
  if (stream_ && stream_->is_finished && !stream_->is_writing) end_stream(lock);
  is_polled_ = false;
  pump();
  changed_.notify_all();
}

void ApplyLane::handle(void* tag, bool ok) {
  Stream& stream = *stream_;
  switch (Tag(reinterpret_cast<std::intptr_t>(tag))) {
    case kStart:
      stream.is_started = ok;
      stream.calls->Read(&stream.reply, tag_of(kRead));
      break;
    case kRead:
      if (ok) {
        take_reply();
        stream.calls->Read(&stream.reply, tag_of(kRead));
      } else {
        stream.is_started = false;  // nothing more is written
        stream.calls->Finish(&stream.status, tag_of(kFinish));
      }
      break;
    case kWrite:
      stream.is_writing = false;
      if (!ok) stream.is_started = false;
      break;
    case kFinish:
      stream.is_finished = true;
      break;
  }
}

void ApplyLane::take_reply() {
  const v1::ApplyReply& reply = stream_->reply;
  if (waiting_.empty() || waiting_.front()->request.number() != reply.number())
    return stream_->context.TryCancel();  // an answer to nothing: begin again
  const auto edit = std::move(waiting_.front());
  waiting_.pop_front();
  --sent_;
  patience_.reset();
  if (reply.status().code() != 0) {
    edit->error = to_error(reply.status());
    if (edit->error->field() == "number" || edit->error->details().retry_seconds > 0)
      next_.erase(edit->request.scene());  // the number is still free, and all after it
  } else {
    edit->revision = reply.revision();
    for (const IdTarget& target : edit->targets)
      give_ids(target, reply, edit->request.transaction().edits_size());
  }
  edit->is_done = true;
}

/// Ends a stream: sends edits without a reply again, or gives them the error.
void ApplyLane::end_stream(Lock& lock) {
  const auto stream = std::move(stream_);
  sent_ = 0;
  if (waiting_.empty()) return;
  const bool is_lost_session = stream->status.error_code() == grpc::UNAUTHENTICATED;
  bool again = is_lost(stream->status) || is_lost_session;
  if (!patience_ || is_lost_session) patience_.emplace();  // the daemon is back, for however long
  if (again) {
    lock.unlock();
    again = is_lost_session ? session_.resume(stream->openings, session_.error_of(stream->status))
                            : !session_.is_daemon_dead() && patience_->wait();
    lock.lock();
  }
  if (again && !session_.is_closed()) return open();
  const grpc::Status status =
      stream->status.ok() ? grpc::Status(grpc::UNAVAILABLE, "the daemon stopped") : stream->status;
  fail_all(session_.error_of(status));
}

void ApplyLane::fail_all(const ClientError& error) {
  for (const auto& edit : waiting_) {
    edit->error = error;
    edit->is_done = true;
    next_.erase(edit->request.scene());  // it may have been applied or not
  }
  waiting_.clear();
  sent_ = 0;
  patience_.reset();
}

}  // namespace heliograph::client::wire
