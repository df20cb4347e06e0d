// Joints that move a vertex. Used by loaders of skins.
#pragma once

#include <vector>

#include "renderer/assets/mesh_data.h"

namespace heliograph::assets {

struct Influence {
  u32 joint;  // at most 65535
  float weight;
};
/// Adds a vertex to joints and weights: the four strongest influences, of equal ones the first
/// joints, with weights that sum to 1. Without a weight above 0 it follows the first joint.
void keep_strongest(std::vector<Influence>& influences, MeshData& mesh);

}  // namespace heliograph::assets
