// The bundled studio, and domes as textures. Called by Edits.
#pragma once

#include <string>

#include "heliograph/geometry.h"
#include "wire/draft.h"

namespace heliograph::client::wire {

/// (256, 512, 3) f16 radiance, lat-long, row 0 at +Z: a room with soft boxes.
Array studio_dome();

struct DomeTexture {
  std::string name;  // names its content: the same dome is the same object
  v1::Texture message;
};
DomeTexture dome_texture(const Image& image, Draft& draft);

}  // namespace heliograph::client::wire
