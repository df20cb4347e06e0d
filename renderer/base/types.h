// The short names used everywhere in the renderer: integers and GLM vectors.
#pragma once

#include <cstdint>
#include <glm/glm.hpp>
#include <glm/gtc/quaternion.hpp>

namespace heliograph {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using u32 = std::uint32_t;
using u64 = std::uint64_t;
using i32 = std::int32_t;
using i64 = std::int64_t;

using glm::ivec3;
using glm::mat3;
using glm::mat4;
using glm::mat4x3;  // affine: four columns of three; p_to = m * vec4(p_from, 1)
using glm::quat;
using glm::uvec2;
using glm::uvec3;
using glm::vec2;
using glm::vec3;
using glm::vec4;

}  // namespace heliograph
