// Planes of the wire and of the kernels: a plane in only one of the two lists does not compile.
#include "server/convert/render.h"

namespace heliograph::server {

Expected<Plane> to_plane(v1::Plane plane) {
  switch (plane) {
#define HELIO_PLANE(NAME, ...) \
  case v1::PLANE_##NAME:       \
    return Plane::NAME;
    HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
    case v1::PLANE_UNSPECIFIED:
    case v1::Plane_INT_MIN_SENTINEL_DO_NOT_USE_:
    case v1::Plane_INT_MAX_SENTINEL_DO_NOT_USE_:
      break;
  }
  return fail(Code::kInvalidArgument, "", "is not set; name a plane, such as PLANE_BEAUTY");
}

v1::Plane to_proto(Plane plane) {
  switch (plane) {
#define HELIO_PLANE(NAME, ...) \
  case Plane::NAME:            \
    return v1::PLANE_##NAME;
    HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
    case Plane::kCount:
      break;
  }
  return v1::PLANE_UNSPECIFIED;
}

}  // namespace heliograph::server
