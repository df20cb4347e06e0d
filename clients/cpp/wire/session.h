// Session with a daemon: channel, local channel, typed errors, retries. Used by all that calls.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "google/rpc/status.pb.h"
#include "heliograph/client.h"
#include "heliograph/error.h"
#include "heliograph/v1/service.grpc.pb.h"
#include "wire/launch.h"
#include "wire/local_channel.h"

namespace heliograph::client::wire {

class ApplyLane;
class Uploads;

/// The error of a status that is not OK.
ClientError to_error(const google::rpc::Status& status);

constexpr double kRetrySeconds = 10;  // how long a daemon that is unavailable is tried again

/// Random name of a call that is to take effect once.
std::string make_request_id();

/// The waits between repeated calls: 20 ms, doubling up to 250 ms, 10 s in all by default.
class Patience {
 public:
  explicit Patience(double seconds = kRetrySeconds)
      : end_(std::chrono::steady_clock::now() +
             std::chrono::milliseconds(std::int64_t(1000 * seconds))) {}
  /// Seconds, 0 at least.
  [[nodiscard]] double left() const {
    const auto left = end_ - std::chrono::steady_clock::now();
    return std::max(0.0, std::chrono::duration<double>(left).count());
  }
  /// Sleeps, or reports that there is no more time.
  bool wait() {
    const auto now = std::chrono::steady_clock::now();
    if (now > end_) return false;
    std::this_thread::sleep_for(delay_);
    delay_ = std::min(2 * delay_, std::chrono::milliseconds(250));
    return true;
  }

 private:
  std::chrono::steady_clock::time_point end_;
  std::chrono::milliseconds delay_{20};
};

/// Owns: channel, local channel, private daemon. Thread: any. Every call throws ClientError.
class Session : public std::enable_shared_from_this<Session> {
 public:
  using Stub = v1::Renderer::Stub;

  Session(std::string address, const ConnectOptions& options,
          std::unique_ptr<PrivateDaemon> daemon);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  /// A unary call, repeated while the daemon is unavailable: what may not be done twice carries a
  /// number or a request id.
  template <class Request, class Reply>
  Reply call(grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Reply*),
             const Request& request) {
    Reply reply;
    retry([&](grpc::ClientContext& context) {
      reply.Clear();
      return (stub_.get()->*method)(&context, request, &reply);
    });
    return reply;
  }

  /// Calls a method that answers with several messages, as call() does.
  template <class Request, class Reply>
  std::vector<Reply> call(std::unique_ptr<grpc::ClientReader<Reply>> (Stub::*method)(
                              grpc::ClientContext*, const Request&),
                          const Request& request) {
    std::vector<Reply> replies;
    retry([&](grpc::ClientContext& context) {
      replies.clear();
      const auto reader = (stub_.get()->*method)(&context, request);
      for (Reply reply; reader->Read(&reply);) replies.push_back(std::move(reply));
      return reader->Finish();
    });
    return replies;
  }

  /// Throws kUnavailable once it is closed.
  void check_open() const;
  /// Puts the session into a call. Throws kUnavailable once it is closed.
  void prepare(grpc::ClientContext& context) const;
  /// Adds the headers of a call, also where the session may be closed.
  void authorize(grpc::ClientContext& context) const;
  /// Number of times that the session was opened: above 1 where the daemon was restarted.
  [[nodiscard]] std::uint64_t openings() const { return openings_; }
  /// True if a call that began after `openings` openings failed because the daemon was restarted,
  /// and the session goes on: with the numbering of the edits of durable scenes, without anything
  /// else.
  bool resume(std::uint64_t openings, const ClientError& failure);
  /// Throws the error of a call that failed; kUnavailable where the session was resumed.
  void check(const grpc::Status& status);
  /// Error of a call; states how a private daemon died, if that is why.
  ClientError error_of(const grpc::Status& status);
  [[nodiscard]] bool is_daemon_dead();

  [[nodiscard]] Stub& stub() const { return *stub_; }
  [[nodiscard]] const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  [[nodiscard]] const std::string& address() const { return address_; }
  [[nodiscard]] const v1::GetServerInfoReply& server() const { return server_; }
  [[nodiscard]] Uploads& uploads() const { return *uploads_; }
  /// The lane that carries the edits of a scene.
  [[nodiscard]] ApplyLane& lane_of(std::uint64_t scene) const;
  [[nodiscard]] bool is_closed() const { return closed_; }
  void close();

 private:
  void start(std::uint64_t resumed, Patience patience);
  v1::OpenSessionReply begin(std::uint64_t resumed, Patience& patience);
  v1::OpenSessionReply open(const std::string& ticket, std::uint64_t resumed, double seconds);
  void keep();
  void stop_keeping();
  void retry(const std::function<grpc::Status(grpc::ClientContext&)>& attempt);

  std::string address_;
  std::string token_;
  TraceHeaders trace_;
  std::unique_ptr<PrivateDaemon> daemon_;
  std::string socket_;  // path of the Unix socket, or ""
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<Stub> stub_;
  std::string session_;  // the same for all its life
  v1::GetServerInfoReply server_;
  std::atomic<std::uint64_t> openings_{0};
  std::mutex opening_;  // of what follows, up to keep_
  std::unique_ptr<LocalChannel> local_channel_;
  // Over TCP a stream carries the session; nothing ever arrives on it.
  std::unique_ptr<grpc::ClientContext> keep_context_;
  std::unique_ptr<grpc::ClientReader<v1::KeepSessionReply>> keep_;
  std::unique_ptr<Uploads> uploads_;
  std::vector<std::unique_ptr<ApplyLane>> lanes_;
  std::atomic<bool> closed_{false};
};

}  // namespace heliograph::client::wire
