// The interceptor behind record_calls.h.
#include "server/observe/record_calls.h"

#include <grpcpp/server_context.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>

#include "heliograph/v1/service.pb.h"

namespace heliograph::server {
namespace {

using grpc::experimental::InterceptionHookPoints;
using grpc::experimental::InterceptorBatchMethods;
using grpc::experimental::ServerRpcInfo;

// ---------------------------------------------------------------- requests

/// Returns the bulk bytes field of a message; null: it has none.
template <class Message>
std::string* chunk_of(Message&) {
  return nullptr;
}
std::string* chunk_of(v1::UploadBlobRequest& message) { return message.mutable_chunk(); }
std::string* chunk_of(v1::SceneChunk& message) {
  return message.has_chunk() ? message.mutable_chunk() : nullptr;
}

template <class Message>
void take_request(void* data, Note& note) {
  auto& message = *static_cast<Message*>(data);
  std::string chunk;
  std::string* bulk = chunk_of(message);
  if (bulk != nullptr) bulk->swap(chunk);
  message.SerializeToString(note.item.mutable_request()->mutable_message());
  if (bulk == nullptr) return;
  note.bulk = chunk;
  bulk->swap(chunk);
}

// ---------------------------------------------------------------- replies

using FramePtr = std::shared_ptr<const Frame>;

void take_frame(const v1::FrameHeader& header, FramePtr frame, Note& note) {
  v1::RecordFrame& item = *note.item.mutable_frame();
  item.set_frame(header.frame());
  item.set_revision(header.revision());
  item.set_samples(header.samples());
  item.set_final(header.final());
  item.set_manifest(header.manifest());
  note.frame = std::move(frame);
}

/// Fills a note with a reply; `frame` is the frame that it begins. False: the reply is not
/// recorded.
template <class Message>
bool take_reply(const Message& message, const FramePtr&, Note& note) {
  message.SerializeToString(note.item.mutable_reply()->mutable_message());
  return true;
}
template <>
bool take_reply(const v1::DecodeAssetReply& message, const FramePtr&, Note& note) {
  if (!message.has_asset() && message.missing_size() == 0) return false;  // progress
  message.SerializeToString(note.item.mutable_reply()->mutable_message());
  return true;
}
template <>
bool take_reply(const v1::FramePart& message, const FramePtr& frame, Note& note) {
  if (!message.has_header()) return false;
  take_frame(message.header(), frame, note);
  return true;
}
template <>
bool take_reply(const v1::RenderBatchReply& message, const FramePtr& frame, Note& note) {
  if (message.done()) {
    message.SerializeToString(note.item.mutable_reply()->mutable_message());
    return true;
  }
  if (!take_reply(message.part(), frame, note)) return false;
  note.item.mutable_frame()->set_tag(message.tag());
  return true;
}

// ---------------------------------------------------------------- questions

template <class Reply>
bool take_answer(const void* message, const FramePtr&, Note& note) {
  note.answer = std::make_unique<Reply>(*static_cast<const Reply*>(message));
  return true;
}

// ---------------------------------------------------------------- methods

struct Method {
  std::string_view name;
  void (*request)(void* message, Note& note);
  bool (*reply)(const void* message, const FramePtr& frame, Note& note);
};

template <class Request, class Reply>
constexpr Method method(std::string_view name) {
  return {name, take_request<Request>, [](const void* message, const FramePtr& frame, Note& note) {
            return take_reply(*static_cast<const Reply*>(message), frame, note);
          }};
}

template <class Request, class Reply>
constexpr Method question(std::string_view name) {
  return {name, take_request<Request>, take_answer<Reply>};
}

/// Recorded methods: those that change scenes or objects that edits refer to, or ask for frames or
/// for information.
constexpr std::array kMethods = {
    method<v1::CreateSceneRequest, v1::SceneInfo>("CreateScene"),
    method<v1::OpenSceneRequest, v1::SceneInfo>("OpenScene"),
    method<v1::BranchSceneRequest, v1::SceneInfo>("BranchScene"),
    method<v1::DeleteSceneRequest, v1::DeleteSceneReply>("DeleteScene"),
    method<v1::ApplyRequest, v1::ApplyReply>("Apply"),
    method<v1::ApplyRequest, v1::ApplyReply>("ApplyStream"),
    method<v1::UploadBlobRequest, v1::UploadBlobReply>("UploadBlob"),
    method<v1::DecodeAssetRequest, v1::DecodeAssetReply>("DecodeAsset"),
    method<v1::SceneChunk, v1::SceneInfo>("ImportScene"),
    method<v1::RenderRequest, v1::FramePart>("Render"),
    method<v1::RenderBatchRequest, v1::RenderBatchReply>("RenderBatch"),
    method<v1::StreamRequest, v1::FramePart>("Stream"),
    question<v1::ReadRequest, v1::ReadReply>("Read"),
    question<v1::QueryRequest, v1::QueryReply>("Query"),
    question<v1::TracksRequest, v1::TracksReply>("Tracks"),
    question<v1::DescribeSceneRequest, v1::DescribeSceneReply>("DescribeScene"),
    question<v1::ExportSceneRequest, v1::SceneChunk>("ExportScene"),
    question<v1::WatchRequest, v1::WatchReply>("Watch"),
};

const Method* find_method(std::string_view path) {
  constexpr std::string_view kService = "/heliograph.v1.Renderer/";
  if (!path.starts_with(kService)) return nullptr;
  path.remove_prefix(kService.size());
  const auto* found = std::ranges::find(kMethods, path, &Method::name);
  return found == kMethods.end() ? nullptr : found;
}

// ---------------------------------------------------------------- a call

class Tap final : public grpc::experimental::Interceptor {
 public:
  Tap(Recorder& recorder, const Method& method, const grpc::ServerContextBase* context)
      : recorder_(recorder), method_(method), context_(context) {}
  Tap(const Tap&) = delete;
  Tap& operator=(const Tap&) = delete;
  ~Tap() override {
    (void)recorder_.take_frame(context_);
    (void)recorder_.take_revision(context_);
  }

  void Intercept(InterceptorBatchMethods* methods) override {
    const auto is = [&](InterceptionHookPoints point) {
      return methods->QueryInterceptionHookPoint(point);
    };
    if (is(InterceptionHookPoints::POST_RECV_INITIAL_METADATA))
      begin(*methods->GetRecvInitialMetadata());
    if (call_ != 0) {
      if (is(InterceptionHookPoints::POST_RECV_MESSAGE)) on_request(methods->GetRecvMessage());
      if (is(InterceptionHookPoints::PRE_SEND_MESSAGE)) on_reply(methods->GetSendMessage());
      if (is(InterceptionHookPoints::PRE_SEND_STATUS)) on_status(*methods);
    }
    methods->Proceed();
  }

 private:
  /// Begins to record a call of an open session; others change nothing, and a stranger's calls must
  /// cost nothing.
  void begin(const std::multimap<grpc::string_ref, grpc::string_ref>& metadata) {
    const auto found = metadata.find("heliograph-session");
    if (found == metadata.end()) return;
    u64 id = 0;
    std::from_chars(found->second.begin(), found->second.end(), id);
    const u64 session = recorder_.session(id);
    if (session == 0) return;
    call_ = recorder_.next_call();
    Note note;
    v1::RecordCall& item = *note.item.mutable_call();
    item.set_call(call_);
    item.set_session(session);
    item.set_method(std::string(method_.name));
    recorder_.note(std::move(note));
  }

  void on_request(void* message) {
    if (message == nullptr) return;  // the client sends no more
    Note note;
    note.item.mutable_request()->set_call(call_);
    method_.request(message, note);
    recorder_.note(std::move(note));
  }

  void on_reply(const void* message) {
    Note note;
    if (!method_.reply(message, recorder_.take_frame(context_), note)) return;
    if (note.item.has_frame())
      note.item.mutable_frame()->set_call(call_);
    else
      note.item.mutable_reply()->set_call(call_);
    recorder_.note(std::move(note));
  }

  void on_status(InterceptorBatchMethods& methods) {
    Note note;
    v1::RecordStatus& item = *note.item.mutable_status();
    item.set_call(call_);
    const grpc::Status status = methods.GetSendStatus();
    item.mutable_status()->ParseFromString(status.error_details());
    item.mutable_status()->set_code(int(status.error_code()));
    item.mutable_status()->set_message(status.error_message());
    if (const auto revision = recorder_.take_revision(context_)) item.set_revision(*revision);
    recorder_.note(std::move(note));
  }

  Recorder& recorder_;
  const Method& method_;
  const grpc::ServerContextBase* const context_;
  u64 call_ = 0;  // 0: not recorded
};

}  // namespace

grpc::experimental::Interceptor* RecordCalls::CreateServerInterceptor(ServerRpcInfo* info) {
  const Method* method = recorder_.is_on() ? find_method(info->method()) : nullptr;
  return method != nullptr ? new Tap(recorder_, *method, info->server_context()) : nullptr;
}

}  // namespace heliograph::server
