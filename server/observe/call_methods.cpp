#include "server/observe/call_methods.h"

#include <algorithm>
#include <array>

#include "heliograph/v1/service.pb.h"

namespace heliograph::server {
namespace {

template <class Request>
u64 scene_of(const Request& request) {
  if constexpr (requires { request.scene(); })
    return request.scene();
  else
    return 0;
}
u64 scene_of(const v1::StreamRequest& request) { return request.settings().scene(); }
u64 scene_of(const v1::RenderBatchRequest& request) { return request.job().scene(); }

template <class Request>
constexpr CallMethod method(std::string_view name, Pace pace, bool gives_scene = false) {
  return {name, pace,
          [](const void* message) {
            const Request& request = *static_cast<const Request*>(message);
            return Asked{request.ByteSizeLong(), scene_of(request)};
          },
          gives_scene};
}

constexpr bool kGivesScene = true;
constexpr std::array kMethods = {
    method<v1::GetServerInfoRequest>("GetServerInfo", Pace::kShort),
    method<v1::OpenSessionRequest>("OpenSession", Pace::kShort),
    method<v1::KeepSessionRequest>("KeepSession", Pace::kClient),
    method<v1::CloseSessionRequest>("CloseSession", Pace::kShort),
    method<v1::CreateSceneRequest>("CreateScene", Pace::kShort, kGivesScene),
    method<v1::OpenSceneRequest>("OpenScene", Pace::kShort, kGivesScene),
    method<v1::BranchSceneRequest>("BranchScene", Pace::kShort, kGivesScene),
    method<v1::DeleteSceneRequest>("DeleteScene", Pace::kShort),
    method<v1::ListScenesRequest>("ListScenes", Pace::kShort),
    method<v1::DescribeSceneRequest>("DescribeScene", Pace::kShort),
    method<v1::ApplyRequest>("Apply", Pace::kShort),
    method<v1::ApplyRequest>("ApplyStream", Pace::kClient),
    method<v1::UploadBlobRequest>("UploadBlob", Pace::kClient),
    method<v1::LendBufferRequest>("LendBuffer", Pace::kShort),
    method<v1::DecodeAssetRequest>("DecodeAsset", Pace::kRender),
    method<v1::ReadRequest>("Read", Pace::kClient),
    method<v1::ExportSceneRequest>("ExportScene", Pace::kClient),
    method<v1::SceneChunk>("ImportScene", Pace::kClient, kGivesScene),
    method<v1::QueryRequest>("Query", Pace::kRender),
    method<v1::TracksRequest>("Tracks", Pace::kRender),
    method<v1::RenderRequest>("Render", Pace::kRender),
    method<v1::WatchRequest>("Watch", Pace::kClient),
    method<v1::StreamRequest>("Stream", Pace::kClient),
    method<v1::RenderBatchRequest>("RenderBatch", Pace::kClient),
};

}  // namespace

const CallMethod* find_call_method(std::string_view path) {
  constexpr std::string_view kService = "/heliograph.v1.Renderer/";
  if (!path.starts_with(kService)) return nullptr;
  path.remove_prefix(kService.size());
  const auto* found = std::ranges::find(kMethods, path, &CallMethod::name);
  return found == kMethods.end() ? nullptr : found;
}

}  // namespace heliograph::server
