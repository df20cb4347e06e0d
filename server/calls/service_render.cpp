// Render: one request, its frames.
#include "server/calls/frame_stream.h"
#include "server/calls/render_task.h"
#include "server/calls/rpc.h"
#include "server/calls/service.h"

namespace heliograph::server {
namespace {

Status start_render(Daemon& daemon, const v1::RenderRequest& request,
                    const std::shared_ptr<FrameStream>& stream) {
  const CallScope& scope = stream->scope();
  auto task = to_task(daemon, *scope.session(), request, record_of(scope.context()));
  if (!task) return std::unexpected(task.error());
  HELIO_TRY(task->charge(request.ByteSizeLong()));
  task->job->deadline = scope.deadline();
  HELIO_TRY(stream->provide(*task));
  stream->expect(*task);
  return submit(daemon, *task, stream, scope.stop());
}

}  // namespace

Writer<v1::FramePart>* Service::Render(Context* context, const v1::RenderRequest* request) {
  using Reactor = Writer<v1::FramePart>;
  return let_in<Reactor>(daemon_.gate, context, Needs::kSession, [&](Call call) {
    auto stream = FrameStream::start(daemon_, *context, std::move(call));
    auto task = [this, request, stream] {
      if (stream->scope().is_stopped())
        return stream->refuse(fail(Code::kCancelled, "", "cancelled"));
      if (auto started = start_render(daemon_, *request, stream); !started) stream->refuse(started);
    };
    const u64 tenant = stream->scope().session()->tenant()->id;
    if (auto posted = daemon_.pool.post(tenant, std::move(task)); !posted) stream->refuse(posted);
    return stream.get();
  });
}

}  // namespace heliograph::server
