#include "server/calls/quick_calls.h"

#include <sys/socket.h>

#include <array>
#include <cstring>
#include <system_error>
#include <thread>
#include <utility>

#include "server/calls/edit_calls.h"
#include "server/calls/render_task.h"
#include "server/calls/rpc.h"
#include "server/convert/error.h"
#include "server/convert/frame.h"
#include "server/convert/transaction.h"
#include "server/os/packet.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kPacketBytes = 64 << 10;
constexpr const char* kApply = "/heliograph.v1.Renderer/Apply";
constexpr const char* kRender = "/heliograph.v1.Renderer/Render";

bool is_packet_socket(int fd) {
  int domain = 0, type = 0;
  socklen_t size = sizeof domain;
  return ::getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &domain, &size) == 0 && domain == AF_UNIX &&
         ::getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0 && type == SOCK_SEQPACKET;
}

bool send(int socket, const void* bytes, std::size_t size, int descriptor) {
  iovec piece{const_cast<void*>(bytes), size};
  return send_packet(socket, std::span(&piece, 1), descriptor);
}

/// Sends a reply; one larger than a packet goes in a memfd, and the packet has its size, a u64.
bool send(int socket, const std::string& reply) {
  if (reply.size() <= kPacketBytes) return send(socket, reply.data(), reply.size(), -1);
  const u64 size = reply.size();
  const auto memory = SealedMemory::create(size);
  if (!memory) return false;
  std::memcpy(memory->bytes().data(), reply.data(), size);
  return send(socket, &size, sizeof size, memory->fd());
}

}  // namespace

/// The socket of one session, and the one call that runs over it.
///
/// The thread of run() begins a call; the thread that ends it sends the reply, after which the next
/// call may begin. Lifetime: held by the thread of run() and by the call's work.
class QuickCalls::FastPathConnection final
    : public JobSink,
      public std::enable_shared_from_this<FastPathConnection> {
 public:
  /// A descriptor with its charges.
  struct Socket {
    ForeignFd fd;
    Charge counted;
    Charge descriptor;
  };
  FastPathConnection(Daemon& daemon, std::shared_ptr<Session> session, Socket socket)
      : daemon_(daemon), session_(std::move(session)), socket_(std::move(socket)) {}

  /// Serves calls until the socket is closed, which cancels the call in flight.
  void run() {
    const std::stop_callback on_end(session_->ended(), [this] { close(); });
    std::array<char, kPacketBytes> packet;
    while (true) {
      const auto got = receive_packet(socket_.fd, packet, 0, daemon_.loop->closer());
      if (!got.descriptors.empty()) break;  // a call has none: protocol error
      const ssize_t size = got.size;
      if (size <= 0 || std::size_t(size) > packet.size() || is_busy_.exchange(true)) break;
      if (!call_.ParseFromArray(packet.data(), int(size))) break;
      begin(u64(size));
    }
    close();
    const std::lock_guard lock(mutex_);
    stop_.request_stop();
  }
  void close() { ::shutdown(socket_.fd.get(), SHUT_RDWR); }

  /// Drops an update that the socket does not accept.
  void progress(const Progress& progress) override {
    if (!call_.progress()) return;
    v1::QuickReply reply;
    *reply.mutable_progress() = to_proto(progress);
    (void)send(socket_.fd.get(), reply.SerializeAsString());
  }
  void frame(std::shared_ptr<const Frame> frame) override {
    if (frame->final) frames_.push_back(std::move(frame));
  }
  void done(Status status, const Spent&) override {
    status = session_->with_shutdown_reason(std::move(status));
    if (!status) {
      if (stop_requested()) cutter_->abandon();
      return finish(status);
    }
    for (auto& frame : frames_) {
      cutter_->begin({std::move(frame), headers_}, *reply_.add_parts());
      while (!cutter_->at_end()) (void)cutter_->next(*reply_.add_parts());
    }
    finish({});
  }

 private:
  void begin(u64 bytes) {
    record_ = std::make_shared<CallRecord>();
    record_->note([&](CallFacts& facts) {
      facts.start = CallClock::now();
      facts.request = new_request_id();
      facts.method = call_.has_render() ? kRender : kApply;
      facts.pace = call_.has_render() ? Pace::kRender : Pace::kShort;
      facts.scene = call_.has_render() ? call_.render().scene() : call_.apply().scene();
      facts.peer = "unix:";
      facts.received_bytes = bytes;
    });
    {
      const std::lock_guard lock(mutex_);
      stop_ = {};
    }
    auto admitted = daemon_.gate.admit({.is_local = true, .token = call_.token()}, session_->id());
    if (!admitted) return finish(std::unexpected(std::move(admitted).error()));
    admitted_.emplace(*std::move(admitted));
    record_->note([&](CallFacts& facts) { name_caller(*admitted_, facts); });
    if (auto known = check_own_fields(call_); !known) return finish(known);
    if (call_.has_apply()) return apply();
    if (call_.has_render()) return render();
    finish(fail(Code::kInvalidArgument, "call", "needs `apply` or `render`"));
  }

  void apply() {
    const auto done = [self = shared_from_this()](const EditLog::Reply& answer) {
      if (*answer) *self->reply_.mutable_apply() = **answer;
      self->finish(*answer ? Status() : std::unexpected(answer->error()));
    };
    apply_numbered(daemon_, session_, call_.apply(), done, true);
  }

  void render() {
    cutter_.emplace(daemon_.config.limits.chunk_bytes, session_, FrameCutter::Begun());
    if (auto started = start_render(); !started) finish(started);
  }
  Status start_render() {
    auto task = to_task(daemon_, *session_, call_.render(), record_);
    if (!task) return std::unexpected(std::move(task).error());
    headers_ = task->headers;
    HELIO_TRY(cutter_->provide(*task->job, *task->engine));
    return submit(daemon_, *task, shared_from_this(), stop_.get_token());
  }

  bool stop_requested() {
    const std::lock_guard lock(mutex_);
    return stop_.stop_requested();
  }

  /// Ends the call; the only place that does. Touches none of its state once the reply is sent.
  void finish(const Status& status) {
    CallOutcome outcome;
    if (!status) {
      const Error& error = status.error();
      *reply_.mutable_status() = to_proto(error);
      outcome = {.code = int(error.code),
                 .reason = is_hidden(error) ? error.message : reply_.status().message(),
                 .is_hidden = is_hidden(error)};
    }
    const std::string bytes = reply_.SerializeAsString();
    CallFacts facts = record_->facts();
    facts.sent_bytes = bytes.size();
    daemon_.call_log.end(std::move(facts), outcome);
    if (admitted_) admitted_->release_slot();
    const auto until_sent = std::exchange(admitted_, std::nullopt);  // a drain waits for the reply
    forget();
    is_busy_ = false;
    if (!send(socket_.fd.get(), bytes)) close();
  }
  /// Releases the call's state: an idle session holds neither a scene nor memory for calls.
  void forget() {
    call_ = {};
    reply_ = {};
    cutter_.reset();
    headers_.reset();
    frames_ = {};
  }

  Daemon& daemon_;
  const std::shared_ptr<Session> session_;
  const Socket socket_;
  std::mutex mutex_;
  std::stop_source stop_;              // of the call; guarded by mutex_
  std::atomic<bool> is_busy_ = false;  // true: the members below belong to the call in flight

  v1::QuickCall call_;
  v1::QuickReply reply_;
  CallRecordPtr record_;
  std::optional<Call> admitted_;
  std::optional<FrameCutter> cutter_;
  std::shared_ptr<FrameHeaders> headers_;
  std::vector<std::shared_ptr<const Frame>> frames_;
};

bool QuickCalls::are_possible(const Daemon& daemon) { return !daemon.recorder; }

void QuickCalls::serve(const std::shared_ptr<Session>& session, ForeignFd socket) {
  if (!are_possible(daemon_) || !is_packet_socket(socket.get())) return;
  const Ledger& ledger = session->tenant()->ledger;
  auto counted = Charge::take(ledger.quick_calls, 1);
  auto descriptor = Charge::take(ledger.descriptors, 1);
  if (!counted || !descriptor) return;
  auto connection = std::make_shared<FastPathConnection>(
      daemon_, session,
      FastPathConnection::Socket{std::move(socket), std::move(*counted), std::move(*descriptor)});
  const std::lock_guard lock(mutex_);
  const auto before = connections_.find(session->id());
  if (before != connections_.end()) before->second->close();
  if (is_stopped_) return;
  try {
    std::thread([this, connection, id = session->id()]() mutable {
      connection->run();
      forget(id, std::move(connection));
    }).detach();
  } catch (const std::system_error& error) {
    return daemon_.log.error("no thread for quick calls", {{"reason", error.what()}});
  }
  ++threads_;
  connections_[session->id()] = connection;
}

/// Releases the connection before stop() may return: its socket and charges refer to the daemon.
void QuickCalls::forget(u64 session, std::shared_ptr<FastPathConnection> connection) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = connections_.find(session);
    if (found != connections_.end() && found->second == connection) connections_.erase(found);
  }
  connection.reset();
  const std::lock_guard lock(mutex_);
  if (--threads_ == 0) ended_.notify_all();
}

void QuickCalls::stop() {
  std::unique_lock lock(mutex_);
  is_stopped_ = true;
  for (const auto& [session, connection] : connections_) connection->close();
  ended_.wait(lock, [this] { return threads_ == 0; });
}

}  // namespace heliograph::server
