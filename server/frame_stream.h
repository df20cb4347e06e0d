// Frames on their way to a client: a mailbox between the device thread and one gRPC write in
// flight.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>

#include "heliograph/v1/render.pb.h"
#include "renderer/engine/engine.h"
#include "server/config.h"
#include "server/rpc.h"

namespace heliograph::server {

/// The reply side of Render.
///
/// The mailbox holds at most one progress message, one passing frame a camera (a newer one replaces
/// it) and each camera's final frame; chunks are cut when they are written, so a slow reader costs
/// the frames of its own job and stalls nobody.
/// Thread: any; sink calls come from the device thread and do not block.
/// Lifetime: holds itself until gRPC is done; the engine holds it as its sink.
class FrameStream final : public grpc::ServerWriteReactor<v1::FramePart>, public JobSink {
 public:
  using MakeHeader = std::function<v1::FrameHeader(const Frame&)>;

  [[nodiscard]] static std::shared_ptr<FrameStream> start(grpc::CallbackServerContext& context,
                                                          Call call, const Limits& limits);

  /// How headers are made; set once, before the engine has the sink.
  void set_header(MakeHeader make_header) { make_header_ = std::move(make_header); }
  [[nodiscard]] const std::shared_ptr<Session>& session() const { return call_.session(); }
  /// When the client gives up.
  [[nodiscard]] std::optional<std::chrono::steady_clock::time_point> deadline() const {
    return deadline_of(context_);
  }
  /// Stops when the client cancels, its deadline passes, or the session ends.
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }

  void progress(const Progress& progress) override;
  void frame(std::shared_ptr<const Frame> frame) override;
  void done(Status status) override;

  void OnWriteDone(bool ok) override;
  void OnCancel() override { stop_.request_stop(); }
  void OnDone() override;

 private:
  FrameStream(grpc::CallbackServerContext& context, Call call, u64 chunk_bytes);
  void pump();
  [[nodiscard]] bool next_part();  // fills part_; under mutex_
  void begin_frame(std::shared_ptr<const Frame> frame);
  void cut_chunk();

  grpc::CallbackServerContext& context_;
  Call call_;
  const u64 chunk_bytes_;
  MakeHeader make_header_;
  std::stop_source stop_;
  std::optional<std::stop_callback<std::function<void()>>> on_session_end_;
  std::shared_ptr<FrameStream> self_;  // until OnDone

  std::mutex mutex_;
  std::optional<Progress> progress_;
  std::deque<std::shared_ptr<const Frame>> frames_;
  std::optional<Status> result_;
  std::shared_ptr<const Frame> sending_;
  u32 plane_ = 0;   // of sending_
  u64 offset_ = 0;  // bytes into that plane
  bool is_writing_ = false;
  bool is_finished_ = false;
  v1::FramePart part_;
};

}  // namespace heliograph::server
