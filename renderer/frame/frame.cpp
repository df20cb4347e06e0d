// Facts of planes and types, derived from HELIO_PLANES.
#include "renderer/frame/frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace heliograph {
namespace {

/// A name in lower case, kept in static storage.
template <std::size_t N>
struct LowerCase {
  char text[N];
  constexpr explicit LowerCase(const char (&upper)[N]) : text{} {
    for (std::size_t i = 0; i < N; ++i)
      text[i] = upper[i] >= 'A' && upper[i] <= 'Z' ? char(upper[i] - 'A' + 'a') : upper[i];
  }
};

#define HELIO_PLANE(NAME, ...) constexpr LowerCase kName_##NAME(#NAME);
HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE

constexpr std::array kPlaneInfos{
#define HELIO_PLANE(NAME, type, channels, fold, unit, ...) \
  PlaneInfo{kName_##NAME.text, dtype_of<type>(), channels, unit, kernels::Fold::fold},
    HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
};

u64 plane_bytes(Plane plane, u64 pixels) {
  const PlaneInfo& info = plane_info(plane);
  return pixels * info.channels * size_of(info.dtype);
}

}  // namespace

PlaneData new_plane(const RenderJob& job, Plane plane, u64 pixels) {
  const bool is_asked_for = std::ranges::count(job.planes, plane) > 0;
  return {plane, Pixels(plane, plane_bytes(plane, pixels),
                        is_asked_for && !job.on_device ? job.memory : PixelAllocator())};
}

Expected<PlaneData> new_device_plane(const RenderJob& job, Plane plane, u64 pixels) {
  const u64 bytes = plane_bytes(plane, pixels);
  auto memory = job.on_device && job.memory ? job.memory(plane, bytes) : nullptr;
  if (!memory || !memory->is_on_device())
    return fail(Code::kResourceExhausted, "memory",
                fmt::format("there is no device memory for the {} bytes of {}; let go of frames "
                            "that you hold, or ask for smaller ones (limits shared_bytes, "
                            "tenant_bytes)",
                            bytes, plane_info(plane).name));
  return PlaneData{plane, Pixels(bytes, std::move(memory))};
}

std::size_t size_of(DType type) {
  switch (type) {
    case DType::kU8:
      return 1;
    case DType::kU16:
    case DType::kF16:
      return 2;
    case DType::kU32:
    case DType::kI32:
    case DType::kF32:
      return 4;
    case DType::kU64:
    case DType::kF64:
      return 8;
  }
  return 0;
}

const PlaneInfo& plane_info(Plane plane) { return kPlaneInfos[std::size_t(plane)]; }

}  // namespace heliograph
