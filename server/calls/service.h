// The service of service.proto: every call, in the order of that file. The handlers are in
// service_*.cpp by area; each converts, calls, converts back.
#pragma once

#include "heliograph/v1/service.grpc.pb.h"
#include "server/calls/daemon.h"

namespace heliograph::server {

using Context = grpc::CallbackServerContext;
template <class Reply>
using Writer = grpc::ServerWriteReactor<Reply>;
template <class Request>
using Reader = grpc::ServerReadReactor<Request>;

/// The gRPC service. Thread: any.
class Service final : public v1::Renderer::CallbackService {
 public:
  explicit Service(Daemon& daemon) : daemon_(daemon) {}

  using Unary = grpc::ServerUnaryReactor;
  Unary* GetServerInfo(Context*, const v1::GetServerInfoRequest*, v1::GetServerInfoReply*) override;
  Unary* ListSessions(Context*, const v1::ListSessionsRequest*, v1::ListSessionsReply*) override;

  Unary* OpenSession(Context*, const v1::OpenSessionRequest*, v1::OpenSessionReply*) override;
  Writer<v1::KeepSessionReply>* KeepSession(Context*, const v1::KeepSessionRequest*) override;
  Unary* CloseSession(Context*, const v1::CloseSessionRequest*, v1::CloseSessionReply*) override;

  Unary* CreateScene(Context*, const v1::CreateSceneRequest*, v1::SceneInfo*) override;
  Unary* OpenScene(Context*, const v1::OpenSceneRequest*, v1::SceneInfo*) override;
  Unary* BranchScene(Context*, const v1::BranchSceneRequest*, v1::SceneInfo*) override;
  Unary* DeleteScene(Context*, const v1::DeleteSceneRequest*, v1::DeleteSceneReply*) override;
  Unary* ListScenes(Context*, const v1::ListScenesRequest*, v1::ListScenesReply*) override;
  Unary* DescribeScene(Context*, const v1::DescribeSceneRequest*, v1::DescribeSceneReply*) override;

  Unary* Apply(Context*, const v1::ApplyRequest*, v1::ApplyReply*) override;
  grpc::ServerBidiReactor<v1::ApplyRequest, v1::ApplyReply>* ApplyStream(Context*) override;

  Reader<v1::UploadBlobRequest>* UploadBlob(Context*, v1::UploadBlobReply*) override;
  Unary* LendBuffer(Context*, const v1::LendBufferRequest*, v1::BufferRef*) override;
  Writer<v1::DecodeAssetReply>* DecodeAsset(Context*, const v1::DecodeAssetRequest*) override;

  Writer<v1::ReadReply>* Read(Context*, const v1::ReadRequest*) override;
  Writer<v1::SceneChunk>* ExportScene(Context*, const v1::ExportSceneRequest*) override;
  Reader<v1::SceneChunk>* ImportScene(Context*, v1::SceneInfo*) override;
  Writer<v1::QueryReply>* Query(Context*, const v1::QueryRequest*) override;
  Writer<v1::TracksReply>* Tracks(Context*, const v1::TracksRequest*) override;

  Writer<v1::FramePart>* Render(Context*, const v1::RenderRequest*) override;

  Writer<v1::WatchReply>* Watch(Context*, const v1::WatchRequest*) override;
  grpc::ServerBidiReactor<v1::StreamRequest, v1::FramePart>* Stream(Context*) override;
  grpc::ServerBidiReactor<v1::RenderBatchRequest, v1::RenderBatchReply>* RenderBatch(
      Context*) override;

 private:
  Daemon& daemon_;
};

}  // namespace heliograph::server
