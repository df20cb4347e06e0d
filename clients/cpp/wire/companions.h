// Companions: files that a model refers to. clients/python/heliograph/scene/companions.py has the
// same rules.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace heliograph::client::wire {

/// The file that a model in `folder` calls `name` ("/" separates; it may begin with ".."): where it
/// points, else the file of the same name beneath a folder that may be read, or in its
/// materials/textures or textures. Only what lies beneath `folder` or `folders` is found, links
/// followed. The case of ASCII letters may differ.
std::optional<std::filesystem::path> find_companion(const std::filesystem::path& folder,
                                                    const std::string& name,
                                                    const std::vector<std::string>& folders);

/// A file's name as UTF-8: bytes of one that is not are read as Latin-1.
std::string readable(const std::string& name);

}  // namespace heliograph::client::wire
