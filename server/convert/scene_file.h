// Constants of the scene file, shared by export and import.
#pragma once

#include "renderer/base/types.h"

namespace heliograph::server {

inline constexpr const char* kSceneFormat = "heliograph.v1";
inline constexpr u64 kSceneChunk = 1u << 20;
inline constexpr u64 kLargestInline = 4u << 10;      // bytes of an array; longer ones are blobs
inline constexpr u64 kLargestHeader = 512ull << 20;  // bytes in all

}  // namespace heliograph::server
