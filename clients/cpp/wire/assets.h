// Files to assets: uploads a model and its companions, has them decoded. Called by edits.
#pragma once

#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "wire/draft.h"
#include "wire/session.h"

namespace heliograph::client::wire {

/// Asset to decode: a file here or on the server, and how to read it.
struct Source {
  std::string path{};
  std::string server_path{};
  std::string up{};
  double units = 0;
  std::string layer{};
  std::string variant{};
  bool surface = false;
  std::vector<std::string> folders{};
  bool strict = false;
};

/// Calls DecodeAsset, and uploads files that the daemon misses until it misses none.
v1::AssetInfo decode_bundle(Session& session, const Source& source);

/// Index of a name in a file; kNotFound lists its names.
std::size_t known(const std::vector<std::string>& names, const std::string& name,
                  const std::string& field);
/// Handles of the meshes, materials and textures that all placements share.
void list_library(AssetState& asset, const std::string& stem);
void put_placement(const AssetState& asset, const Placement& placement, Draft& draft,
                   v1::Instantiate* out);

}  // namespace heliograph::client::wire
