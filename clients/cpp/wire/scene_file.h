// Scene files: "HELIOSC1", then SceneChunk messages, each after its length (u32, little-endian);
// the same as the Python client's. Called by Scene::save and Client::load_scene.
#pragma once

#include <optional>
#include <string>

#include "heliograph/scene.h"
#include "wire/draft.h"

namespace heliograph::client::wire {

/// Saves a scene. Names the file only once it is complete.
void save_scene(const SceneCore& scene, const std::string& path,
                std::optional<std::uint64_t> revision);

struct ImportAs {
  std::string name;
  Lifetime lifetime = Lifetime::kSession;
};
v1::SceneInfo load_scene(Session& session, const std::string& path, const ImportAs& as);

}  // namespace heliograph::client::wire
