#include "renderer/backend/cuda/place.h"

namespace heliograph::cuda {

Expected<InstancePlacer> InstancePlacer::create(std::shared_ptr<Context> context) {
  const auto program = context->function("place_instances");
  if (!program) return std::unexpected(program.error());
  return InstancePlacer(std::move(context), *program);
}

Status InstancePlacer::place(PlaceLaunch launch) const {
  void* arguments[] = {&launch};
  const u32 blocks = (launch.count + kPlaceThreads - 1) / kPlaceThreads;
  return context_->launch(program_, {blocks, kPlaceThreads}, arguments);
}

}  // namespace heliograph::cuda
