// MTL: the materials of an OBJ. Called by obj.cpp.
#pragma once

#include <map>
#include <set>
#include <string>

#include "renderer/assets/builder.h"

namespace heliograph::assets {

/// Adds to the library the textures and materials that `used` names and the files define, in the
/// metallic-roughness model:
///   base_color = Kd map_Kd, emission = Ke map_Ke, ior = Ni, alpha = d map_d (or 1 - Tr),
///   roughness  = (2 / (Ns + 2))^(1/4), or Pr; metallic = Pm, specular = 2 mean(Ks) up to 1.
/// Source: Wavefront, Object Files, appendix B1; the Pr, Pm, norm extension of MTL.
///
/// files  bundle paths of the MTL files
[[nodiscard]] std::map<std::string, Ref> load_materials(Builder& builder,
                                                        const std::vector<std::string>& files,
                                                        const std::set<std::string>& used);

}  // namespace heliograph::assets
