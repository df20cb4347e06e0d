// A device as those use it whose memory others see, too.
#pragma once

#include "renderer/backend/cuda/pool.h"
#include "renderer/backend/cuda/tenure.h"

namespace heliograph::cuda {

struct ExportDevice {
  const Driver& driver;
  Pool& pool;
  Tenure& tenure;
  Device device = 0;
  ContextHandle context = nullptr;
  StreamHandle stream = nullptr;  // what renders
};

}  // namespace heliograph::cuda
