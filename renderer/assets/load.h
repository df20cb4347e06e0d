// Files to assets: models, pictures, IES profiles, volumes. Linked only by
// heliograph-decode, which runs it inside the sandbox; what comes out is checked again by the
// daemon.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "renderer/base/error.h"
#include "renderer/scene/transaction.h"

namespace heliograph {

/// A file of a bundle, by its path relative to the bundle's folder. An empty companion is one that
/// nobody has: what refers to it is left out with a warning.
struct BundleFile {
  std::string path;
  std::span<const std::byte> bytes;
};

/// Limits of what one load may decode to; more is RESOURCE_EXHAUSTED, before any allocation.
struct LoadLimits {
  u64 bytes = 1ull << 30;     // of all arrays together
  u64 texels = 1ull << 27;    // of one picture
  u64 vertices = 1ull << 26;  // of one mesh
  u64 triangles = 1ull << 27;
  u64 entities = 1ull << 20;
  u64 keys = 1ull << 22;         // of all animations together
  u64 json_bytes = 64ull << 20;  // of a glTF document without its buffers
};

struct LoadOptions {
  std::string format;  // "": by the first file's extension
  // "x", "y", "z": instead of what the file states, or its format's custom; "": these. glTF refuses
  // it.
  std::string up;
  double units = 0;      // metres a unit, likewise; 0: what the file states, without that 1
  std::string layer;     // of a lone picture with several; "": its colours
  std::string variant;   // of a glTF with KHR_materials_variants; "": its default
  bool surface = false;  // of a volume file: its level sets as a mesh, not as fog
  LoadLimits limits{};
  /// Calls a function in as many threads as there are, and returns when all have ended.
  std::function<void(const std::function<void()>&)> in_threads = [](const auto& work) { work(); };
};

/// A model (`asset`), or a lone picture (`image`).
struct Loaded {
  Asset asset;
  std::optional<ImageData> image;
  bool image_srgb = false;
  std::vector<std::string> missing;   // companions the bundle lacks; then there is no asset
  std::vector<std::string> warnings;  // what was ignored or approximated, by name
  vec3 bounds_min{0}, bounds_max{0};  // rest box of the whole model, metres, +Z up
};

/// Loads the first file of the bundle, with the others as its companions.
///
/// Fails with INVALID_ARGUMENT (malformed: names the file, the element and the rule broken),
/// UNIMPLEMENTED (a required extension or a format that is not supported, by name),
/// RESOURCE_EXHAUSTED (it would decode to more than the limits allow).
[[nodiscard]] Expected<Loaded> load_asset(std::span<const BundleFile> bundle,
                                          const LoadOptions& options);

/// Starts and ends the threads that the picture library insists on, so that it starts none later.
/// Call it before anything is loaded, where threads will be refused.
void end_picture_threads();

/// Versions of the libraries in use, for GetServerInfo.
[[nodiscard]] std::string decoder_versions();

}  // namespace heliograph
