// Format of a file by its bytes, whatever its name ends with. Called by load.cpp.
#pragma once

#include <deque>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/load.h"

namespace heliograph::assets {

/// The format of a model, as its files end: "ply", "glb", "stl"; "": these bytes do not show it.
[[nodiscard]] std::string format_of_content(std::span<const std::byte> bytes);

/// The files, those of UTF-16 with a byte order mark in UTF-8; `texts` holds these.
[[nodiscard]] std::vector<BundleFile> in_utf8(std::span<const BundleFile> files,
                                              std::deque<std::string>& texts);

}  // namespace heliograph::assets
