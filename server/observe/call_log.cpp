// The interceptor behind call_log.h.
#include "server/observe/call_log.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>

#include "server/convert/error.h"

namespace heliograph::server {
namespace {

using Clock = std::chrono::steady_clock;
using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using grpc::experimental::ServerRpcInfo;

constexpr const char* kRequestId = "heliograph-request-id";
constexpr std::size_t kLongestId = 64;

bool is_plain(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
         c == '_' || c == ':' || c == '-';
}

class Observer final : public grpc::experimental::Interceptor {
 public:
  Observer(const Log& log, Metrics& metrics, std::string_view method)
      : log_(log), metrics_(metrics), method_(method) {}
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  ~Observer() override {
    const double seconds = std::chrono::duration<double>(Clock::now() - start_).count();
    note_call(log_, metrics_, id_,
              {.method = method_, .code = code_, .seconds = seconds, .sent_bytes = sent_},
              hidden_ ? &*hidden_ : nullptr);
  }

  void Intercept(InterceptorBatchMethods* methods) override {
    const auto is = [&](InterceptionHookPoints point) {
      return methods->QueryInterceptionHookPoint(point);
    };
    if (is(InterceptionHookPoints::POST_RECV_INITIAL_METADATA))
      take_id(*methods->GetRecvInitialMetadata());
    if (is(InterceptionHookPoints::PRE_SEND_MESSAGE))
      if (const grpc::ByteBuffer* message = methods->GetSerializedSendMessage())
        sent_ += message->Length();
    if (is(InterceptionHookPoints::PRE_SEND_STATUS)) take_status(*methods);
    methods->Proceed();
  }

 private:
  void take_id(const std::multimap<grpc::string_ref, grpc::string_ref>& metadata) {
    const auto found = metadata.find(kRequestId);
    if (found != metadata.end()) id_.assign(found->second.data(), found->second.size());
    if (id_.empty() || id_.size() > kLongestId || !std::ranges::all_of(id_, is_plain))
      id_ = new_request_id();
  }

  void take_status(InterceptorBatchMethods& methods) {
    code_ = methods.GetSendStatus().error_code();
    auto& metadata = *methods.GetSendTrailingMetadata();
    metadata.emplace(kRequestId, id_);
    if (auto hidden = metadata.extract(kHiddenMessage)) hidden_ = std::move(hidden.mapped());
  }

  const Log& log_;
  Metrics& metrics_;
  const std::string_view method_;  // gRPC's own
  const Clock::time_point start_ = Clock::now();
  std::string id_;
  std::optional<std::string> hidden_;  // what an error of our own really was
  int code_ = grpc::CANCELLED;         // when it ends without a status of ours
  u64 sent_ = 0;
};

}  // namespace

std::string new_request_id() {
  static const u64 start = u64(Clock::now().time_since_epoch().count());
  static std::atomic<u64> count = 0;
  return fmt::format("{:08x}-{:x}", u32(start ^ (start >> 32)), ++count);
}

void note_call(const Log& log, Metrics& metrics, std::string_view request,
               const Metrics::CallEnd& end, const std::string* hidden) {
  metrics.call(end);
  const std::string_view code = code_name(end.code);
  const LogFields fields = {{"request", request},
                            {"method", end.method},
                            {"code", code},
                            {"seconds", end.seconds},
                            {"sent_bytes", end.sent_bytes}};
  if (hidden)
    return log.error(
        "call",
        {{"request", request}, {"method", end.method}, {"code", code}, {"reason", *hidden}});
  if (end.code == grpc::OK || end.code == grpc::CANCELLED) return log.debug("call", fields);
  log.info("call", fields);
}

grpc::experimental::Interceptor* CallLog::CreateServerInterceptor(ServerRpcInfo* info) {
  return new Observer(log_, metrics_, info->method());
}

}  // namespace heliograph::server
