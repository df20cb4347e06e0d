// Interceptor of call_log.h, between a call's client and its handler.
#include <grpcpp/server_context.h>

#include <algorithm>
#include <atomic>

#include "heliograph/v1/service.pb.h"
#include "server/convert/error.h"
#include "server/observe/call_log.h"
#include "server/observe/call_methods.h"

namespace heliograph::server {
namespace {

using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using grpc::experimental::ServerRpcInfo;
using Metadata = std::multimap<grpc::string_ref, grpc::string_ref>;

constexpr const char* kRequestId = "heliograph-request-id";
constexpr std::size_t kLongestId = 64;

bool is_plain(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == ':' || c == '-';
}

std::string id_of(const Metadata& metadata) {
  const auto found = metadata.find(kRequestId);
  std::string id;
  if (found != metadata.end()) id.assign(found->second.data(), found->second.size());
  const bool is_good = !id.empty() && id.size() <= kLongestId && std::ranges::all_of(id, is_plain);
  return is_good ? id : new_request_id();
}

/// Returns the call's trace. More than one traceparent makes none; lines of tracestate are joined
/// to one list.
Trace trace_of(const Metadata& metadata) {
  const auto [parent, end] = metadata.equal_range("traceparent");
  if (parent == end || std::next(parent) != end) return {};
  std::string state;
  const auto [first, last] = metadata.equal_range("tracestate");
  for (auto line = first; line != last; ++line) {
    if (!state.empty()) state += ',';
    state.append(line->second.data(), line->second.size());
  }
  return parse_trace({parent->second.data(), parent->second.size()}, state);
}

class Observer final : public grpc::experimental::Interceptor {
 public:
  Observer(const CallLog& log, const ServerRpcInfo& info, const RecordedContext& context)
      : log_(log), method_(find_call_method(info.method())), record_(context.record) {
    record_->note([&](CallFacts& facts) {
      facts.method = info.method();
      facts.start = CallClock::now();
      facts.peer = context.peer();
      if (method_ != nullptr) facts.pace = method_->pace;
    });
  }
  /// Observes a call of an unknown method.
  Observer(const CallLog& log, const ServerRpcInfo& info)
      : log_(log), method_(nullptr), record_(std::make_shared<CallRecord>()) {
    record_->note([](CallFacts& facts) {
      facts.method = kUnknownMethod;
      facts.start = CallClock::now();
    });
    outcome_.reason = fmt::format("there is no method {}", info.method());
  }
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  ~Observer() override { log_.end(record_->facts(), outcome_); }

  void Intercept(InterceptorBatchMethods* methods) override {
    const auto is = [&](InterceptionHookPoints point) {
      return methods->QueryInterceptionHookPoint(point);
    };
    if (is(InterceptionHookPoints::POST_RECV_INITIAL_METADATA))
      begin(*methods->GetRecvInitialMetadata());
    if (method_ != nullptr && is(InterceptionHookPoints::POST_RECV_MESSAGE))
      on_request(methods->GetRecvMessage());
    if (is(InterceptionHookPoints::PRE_SEND_MESSAGE)) on_reply(*methods);
    if (is(InterceptionHookPoints::PRE_SEND_STATUS)) on_status(*methods);
    methods->Proceed();
  }

 private:
  void begin(const Metadata& metadata) {
    id_ = id_of(metadata);
    record_->note([&](CallFacts& facts) {
      facts.request = id_;
      facts.trace = trace_of(metadata);
    });
  }

  void on_request(const void* message) {
    if (message == nullptr) return;  // the client sends no more
    const Asked asked = method_->asked(message);
    record_->note([&](CallFacts& facts) {
      facts.received_bytes += asked.bytes;
      if (asked.scene != 0) facts.scene = asked.scene;
    });
  }

  void on_reply(InterceptorBatchMethods& methods) {
    const void* made =
        method_ != nullptr && method_->gives_scene ? methods.GetSendMessage() : nullptr;
    record_->note([&](CallFacts& facts) {
      if (made != nullptr) {
        const auto& scene = *static_cast<const v1::SceneInfo*>(made);
        facts.scene = scene.scene();
        facts.scene_name = scene.name();
      }
      if (const grpc::ByteBuffer* message = methods.GetSerializedSendMessage())
        facts.sent_bytes += message->Length();
    });
  }

  void on_status(InterceptorBatchMethods& methods) {
    const grpc::Status status = methods.GetSendStatus();
    outcome_.code = status.error_code();
    if (!status.error_message().empty()) outcome_.reason = status.error_message();
    auto& metadata = *methods.GetSendTrailingMetadata();
    metadata.emplace(kRequestId, id_);
    if (auto hidden = metadata.extract(kHiddenMessage)) {
      outcome_.reason = std::move(hidden.mapped());
      outcome_.is_hidden = true;
    }
  }

  const CallLog& log_;
  const CallMethod* const method_;  // null: a method of another service
  const CallRecordPtr record_;
  std::string id_;
  CallOutcome outcome_{.code = grpc::CANCELLED};  // unless we set a status
};

}  // namespace

std::string new_request_id() {
  static const u64 start = u64(CallClock::now().time_since_epoch().count());
  static std::atomic<u64> count = 0;
  return fmt::format("{:08x}-{:x}", u32(start ^ (start >> 32)), ++count);
}

grpc::experimental::Interceptor* ObserveCalls::CreateServerInterceptor(ServerRpcInfo* info) {
  const auto* context = dynamic_cast<const RecordedContext*>(info->server_context());
  return context ? new Observer(log_, *info, *context) : new Observer(log_, *info);
}

}  // namespace heliograph::server
