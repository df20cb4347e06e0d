#include "renderer/assets/influences.h"

#include <algorithm>

namespace heliograph::assets {

void keep_strongest(std::vector<Influence>& influences, MeshData& mesh) {
  std::ranges::sort(influences, {},
                    [](const Influence& i) { return std::pair(-i.weight, i.joint); });
  glm::u16vec4 joints(0);
  vec4 weights(0);
  for (int i = 0; i < 4 && std::size_t(i) < influences.size(); ++i) {
    const Influence& influence = influences[std::size_t(i)];
    if (influence.weight <= 0) break;
    joints[i] = u16(influence.joint);
    weights[i] = influence.weight;
  }
  const float sum = weights.x + weights.y + weights.z + weights.w;
  mesh.joints.push_back(joints);
  mesh.weights.push_back(sum > 0 ? weights / sum : vec4(1, 0, 0, 0));
}

}  // namespace heliograph::assets
