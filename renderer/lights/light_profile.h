// Sums over the intensities of a light's profile. Called by lights.cpp and light_strength.cpp.
#pragma once

#include "renderer/derived/derived_cache.h"
#include "renderer/scene/components.h"

namespace heliograph::resident {

/// Sums over the luminance of a profile's texels.
struct ProfileSums {
  double peak = 0;
  double front = 0;  // integral over the directions to the front (-z) of the light, sr
  double back = 0;   // over the others
  [[nodiscard]] static u64 bytes() { return sizeof(ProfileSums); }
};
[[nodiscard]] std::shared_ptr<const ProfileSums> profile_sums(const Texture& texture,
                                                              DerivedCache& cache);

}  // namespace heliograph::resident
