// Opening, keeping and closing a session; statuses to errors.
#include "wire/session.h"

#include <array>
#include <cctype>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <random>
#include <utility>

#include "wire/apply_lane.h"
#include "wire/uploads.h"

namespace heliograph::client::wire {
namespace {

constexpr std::size_t kLanes = 4;
constexpr std::uint32_t kApi = 1;  // the version of the contract, heliograph.vN, that we speak
const char* const kClient = "c++ heliograph " HELIOGRAPH_VERSION;

void check_api(const v1::GetServerInfoReply& server) {
  if (server.max_api() == 0 || (server.min_api() <= kApi && kApi <= server.max_api())) return;
  throw ClientError(Code::kFailedPrecondition,
                    "this daemon (" + server.version() + ") speaks versions " +
                        std::to_string(server.min_api()) + " to " +
                        std::to_string(server.max_api()) + " of the protocol and this client " +
                        std::to_string(kApi) + "; install the client of the daemon's version");
}

struct Target {
  std::string channel;  // of gRPC
  std::string socket;   // path of the Unix socket, or ""
};

/// A path as a URI has it.
std::string quoted(const std::string& path) {
  std::string out;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || std::strchr("/-._~", c) != nullptr) {
      out += c;
      continue;
    }
    out += '%';
    out += "0123456789ABCDEF"[byte >> 4];
    out += "0123456789ABCDEF"[byte & 15];
  }
  return out;
}

Target target_of(const std::string& address) {
  if (address.rfind("unix:", 0) == 0) {
    std::string path = address.substr(5);
    if (path.rfind("//", 0) == 0) path = path.substr(2);
    if (!path.empty() && path[0] == '/') return {"unix://" + quoted(path), path};
  } else {
    const std::size_t colon = address.rfind(':');
    const std::string port = colon == std::string::npos ? "" : address.substr(colon + 1);
    if (colon != 0 && !port.empty() && port.find_first_not_of("0123456789") == std::string::npos)
      return {address, ""};
  }
  throw ClientError(Code::kInvalidArgument,
                    "address: \"" + address + "\" is none; write unix:///path or host:port",
                    {"address"});
}

std::string read_pem(const std::string& path) {
  if (path.empty()) return "";
  std::ifstream file(path, std::ios::binary);
  std::string pem{std::istreambuf_iterator<char>(file), {}};
  if (!pem.empty()) return pem;
  throw ClientError(Code::kInvalidArgument, "tls: cannot read " + path, {"tls"});
}

std::shared_ptr<grpc::ChannelCredentials> credentials_of(const Tls& tls) {
  if (tls.cert.empty() != tls.key.empty())
    throw ClientError(Code::kInvalidArgument, "tls: cert and key go together", {"tls"});
  grpc::SslCredentialsOptions options;
  options.pem_root_certs = read_pem(tls.ca);
  options.pem_cert_chain = read_pem(tls.cert);
  options.pem_private_key = read_pem(tls.key);
  return grpc::SslCredentials(options);
}

std::shared_ptr<grpc::Channel> open_channel(const Target& target, const std::optional<Tls>& tls) {
  if (tls && !target.socket.empty())
    throw ClientError(Code::kInvalidArgument, "tls: is for host:port", {"tls"});
  grpc::ChannelArguments arguments;
  if (tls && !tls->server_name.empty()) arguments.SetSslTargetNameOverride(tls->server_name);
  arguments.SetMaxReceiveMessageSize(-1);
  arguments.SetMaxSendMessageSize(-1);
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 50);
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 5000);  // how long one attempt may take
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 250);
  return grpc::CreateCustomChannel(
      target.channel, tls ? credentials_of(*tls) : grpc::InsecureChannelCredentials(), arguments);
}

std::chrono::system_clock::time_point in_seconds(double seconds) {
  return std::chrono::system_clock::now() + std::chrono::milliseconds(std::int64_t(1000 * seconds));
}

}  // namespace

std::string make_request_id() {
  std::random_device random;
  std::string out;
  for (int i = 0; i < 16; ++i) {
    const auto byte = random() & 0xff;
    out += "0123456789abcdef"[byte >> 4];
    out += "0123456789abcdef"[byte & 15];
  }
  return out;
}

Session::Session(std::string address, const ConnectOptions& options,
                 std::unique_ptr<PrivateDaemon> daemon)
    : address_(std::move(address)),
      token_(options.token),
      trace_(options.trace),
      daemon_(std::move(daemon)) {
  const Target target = target_of(address_);
  socket_ = target.socket;
  channel_ = open_channel(target, options.tls);
  stub_ = v1::Renderer::NewStub(channel_);
  try {
    start(0, Patience(options.timeout));
  } catch (...) {
    if (daemon_) daemon_->give_up();
    throw;
  }
  uploads_ = std::make_unique<Uploads>(*this);
  for (std::size_t i = 0; i < kLanes; ++i) lanes_.push_back(std::make_unique<ApplyLane>(*this));
}

Session::~Session() { close(); }

/// `resumed`: the session of before the daemon was restarted, or 0.
void Session::start(std::uint64_t resumed, Patience patience) {
  const auto reply = begin(resumed, patience);
  if (resumed == 0) {
    session_ = std::to_string(reply.session());
    server_ = reply.server();
  }
  ++openings_;
  if (!local_channel_) keep();
}

v1::OpenSessionReply Session::begin(std::uint64_t resumed, Patience& patience) {
  if (socket_.empty()) return open("", resumed, patience.left());
  for (;;) {
    local_channel_ = std::make_unique<LocalChannel>(socket_ + ".fd.sock", patience.left());
    try {
      return open(local_channel_->ticket(), resumed, patience.left());
    } catch (const ClientError& error) {
      // A ticket that is not known is of a daemon that ended before it was used.
      if (error.details().field != "ticket" || !patience.wait()) throw;
    }
  }
}

v1::OpenSessionReply Session::open(const std::string& ticket, std::uint64_t resumed,
                                   double seconds) {
  v1::OpenSessionRequest request;
  request.set_client(kClient);
  request.set_ticket(ticket);
  request.set_resume(resumed);
  v1::OpenSessionReply reply;
  grpc::ClientContext context;
  context.set_wait_for_ready(true);
  context.set_deadline(in_seconds(seconds));
  if (!token_.empty()) context.AddMetadata("authorization", "Bearer " + token_);
  const grpc::Status status = stub_->OpenSession(&context, request, &reply);
  if (status.error_code() == grpc::DEADLINE_EXCEEDED)
    throw ClientError(Code::kUnavailable, "no daemon answers at " + address_ +
                                              "; start heliographd, correct the address, or "
                                              "raise the timeout");
  if (!status.ok()) throw error_of(status);
  check_api(reply.server());
  return reply;
}

bool Session::resume(std::uint64_t openings, const ClientError& failure) {
  if (failure.code() != Code::kUnauthenticated ||
      server_.journal() == v1::GetServerInfoReply::JOURNAL_NONE)
    return false;
  const std::lock_guard lock(opening_);
  if (closed_ || openings_ != openings) return !closed_;  // another thread was here
  for (Patience patience;;) {
    try {
      stop_keeping();
      start(std::stoull(session_), Patience());
      return true;
    } catch (const ClientError& error) {
      if (error.code() != Code::kUnavailable || !patience.wait()) return false;
    }
  }
}

void Session::keep() {
  keep_context_ = std::make_unique<grpc::ClientContext>();
  prepare(*keep_context_);
  keep_ = stub_->KeepSession(keep_context_.get(), v1::KeepSessionRequest());
  keep_->WaitForInitialMetadata();
}

void Session::stop_keeping() {
  if (!keep_) return;
  keep_context_->TryCancel();
  keep_->Finish();
  keep_.reset();
}

void Session::check_open() const {
  if (closed_) throw ClientError(Code::kUnavailable, "this client is closed; connect() again");
}

void Session::prepare(grpc::ClientContext& context) const {
  check_open();
  authorize(context);
}

void Session::authorize(grpc::ClientContext& context) const {
  context.AddMetadata("heliograph-session", session_);
  if (!token_.empty()) context.AddMetadata("authorization", "Bearer " + token_);
  if (!trace_) return;
  for (const auto& [name, value] : trace_())
    if (name == "traceparent" || name == "tracestate") context.AddMetadata(name, value);
}

void Session::retry(const std::function<grpc::Status(grpc::ClientContext&)>& attempt) {
  for (Patience patience;;) {
    const std::uint64_t openings = openings_;
    grpc::ClientContext context;
    prepare(context);
    const grpc::Status status = attempt(context);
    if (status.ok()) return;
    ClientError error = error_of(status);
    if (resume(openings, error)) {
      patience = Patience();  // the daemon is back, for however long
      continue;
    }
    const bool may_come = error.code() == Code::kUnavailable && !error.details().exit_code;
    if (!may_come || !patience.wait()) throw error;
  }
}

void Session::check(const grpc::Status& status) {
  if (status.ok()) return;
  const ClientError error = error_of(status);
  if (error.code() != Code::kUnauthenticated ||
      server_.journal() == v1::GetServerInfoReply::JOURNAL_NONE)
    throw error;
  v1::ListScenesRequest any;
  any.set_page_size(1);
  call(&Stub::ListScenes, any);  // resumes the session, or throws
  throw ClientError(Code::kUnavailable,
                    "the daemon was restarted, and the session goes on: ask again; anything "
                    "that was not durable is gone");
}

bool Session::is_daemon_dead() { return daemon_ && daemon_->is_dead(); }

ClientError Session::error_of(const grpc::Status& status) {
  const bool is_cut = status.error_code() == grpc::CANCELLED;  // not by us
  if ((is_cut || status.error_code() == grpc::UNAVAILABLE) && is_daemon_dead())
    return daemon_->death("heliographd died");
  if (is_cut)
    return {Code::kUnavailable,
            "the daemon cut the call off, because it ends, or its replies were not read"};
  google::rpc::Status told;
  told.ParseFromString(status.error_details());
  told.set_code(int(status.error_code()));
  told.set_message(status.error_message());
  if (told.details().empty() && status.error_code() == grpc::UNAVAILABLE)  // gRPC's own words
    told.set_message("there is no connection to the daemon, or it was lost in the middle: " +
                     status.error_message());
  return to_error(told);
}

ApplyLane& Session::lane_of(std::uint64_t scene) const { return *lanes_[scene % kLanes]; }

void Session::close() {
  if (closed_.exchange(true)) return;
  for (const auto& lane : lanes_) lane->close();
  if (!session_.empty()) {
    // Should it fail: the end of the local channel frees the same things.
    grpc::ClientContext context;
    context.set_deadline(in_seconds(2));
    authorize(context);
    v1::CloseSessionReply reply;
    stub_->CloseSession(&context, v1::CloseSessionRequest(), &reply);
  }
  {
    const std::lock_guard lock(opening_);
    stop_keeping();
    local_channel_.reset();
  }
  if (daemon_) daemon_->stop();
}

}  // namespace heliograph::client::wire
