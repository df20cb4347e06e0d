// Which channels of a picture are its texels. Used by picture.cpp.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::assets {

/// One to four channels by their numbers in the file, colours first; alpha is the last of two or
/// four.
struct Selection {
  std::vector<u32> channels;
  std::string warning;  // "": nothing was left out or taken for something else
};

/// names  of all channels: "R", "Z", "diffuse.R", "View Layer.Combined.A"
/// layer  a name before the last dot, or a channel's own; "": R, G, B or Y, else the first layer
///        that has them
/// Refuses what cannot be chosen, and lists what there is.
[[nodiscard]] Selection select_channels(const std::vector<std::string>& names,
                                        std::string_view layer, const std::string& where);

/// "a, b, c and 4 more"
[[nodiscard]] std::string listed(const std::vector<std::string>& names);

}  // namespace heliograph::assets
