#include "renderer/assets/load.h"

#include <OpenImageIO/oiioversion.h>
#include <blosc.h>
#include <draco/core/draco_version.h>
#include <meshoptimizer.h>

#include <array>
#include <cmath>
#include <pugixml.hpp>

#include "renderer/assets/builder.h"
#include "renderer/assets/picture.h"

namespace heliograph {
namespace {

using namespace assets;

void check_options(const LoadOptions& options) {
  if (!options.up.empty() && options.up != "x" && options.up != "y" && options.up != "z") {
    refuse("up", "must be \"x\", \"y\" or \"z\"");
  }
  if (!std::isfinite(options.units) || options.units < 0) {
    refuse("units", "must be a positive number of metres");
  }
}

constexpr std::array<std::pair<std::string_view, void (*)(Builder&)>, 8> kModels = {{
    {"gltf", load_gltf},
    {"glb", load_gltf},
    {"dae", load_dae},
    {"obj", load_obj},
    {"ply", load_ply},
    {"stl", load_stl},
    {"nvdb", load_volume},
    {"vdb", load_volume},
}};

void load(Builder& builder) {
  const std::string& path = builder.bundle.model().path;
  const std::string format =
      builder.options.format.empty() ? extension_of(path) : builder.options.format;
  for (const auto& [ending, load_model] : kModels) {
    if (format != ending) continue;
    if (!builder.options.layer.empty()) refuse("layer", "is of pictures; a model has none");
    return load_model(builder);
  }
  if (format == "ies" || is_picture_name(format) || is_picture(builder.bundle.model().bytes)) {
    return load_picture(builder);
  }
  refuse_unimplemented(
      "format", fmt::format("'{}' is not one of gltf, glb, obj, ply, stl, dae, nvdb, vdb, ies, {}",
                            clean_name(format, ""), picture_formats()));
}

Loaded load_bundle(std::span<const BundleFile> files, const LoadOptions& options) {
  check_options(options);
  Builder builder(Bundle(files), options);
  const std::string path = builder.bundle.model().path;
  try {
    load(builder);
    if (builder.complete()) measure(builder.loaded);
  } catch (Refused& refused) {
    constexpr std::size_t kLongestMessage = 2000;
    Error& error = refused.error;
    error.message = clean_text(error.message, kLongestMessage);
    const std::string element = clean_text(error.where, kLongestMessage);
    error.where = clean_text(path, kLongestMessage) + (element.empty() ? "" : ": ") + element;
    throw Refused{std::move(error)};
  }
  if (!builder.complete()) {
    builder.loaded.asset = {};
    return std::move(builder.loaded);
  }
  builder.loaded.asset.name = stem_of(path);
  return std::move(builder.loaded);
}

}  // namespace

namespace assets {

void load_picture(Builder& builder) {
  const BundleFile& file = builder.bundle.model();
  const std::string format =
      builder.options.format.empty() ? extension_of(file.path) : builder.options.format;
  const std::string where;
  Picture picture = format == "ies" ? decode_ies({file.bytes, where, builder.budget})
                                    : decode_picture(file.bytes, format, where, builder.budget,
                                                     builder.options.layer);
  for (const std::string& warning : picture.warnings) builder.warn(warning);
  builder.loaded.image = std::move(picture.image);
  builder.loaded.image_srgb = picture.srgb;
}

}  // namespace assets

Expected<Loaded> load_asset(std::span<const BundleFile> bundle, const LoadOptions& options) {
  try {
    return load_bundle(bundle, options);
  } catch (Refused& refused) {
    return std::unexpected(std::move(refused.error));
  } catch (const std::bad_alloc&) {
    return fail(Code::kResourceExhausted, "files", "out of memory while decoding");
  } catch (const std::length_error&) {
    return fail(Code::kResourceExhausted, "files", "an array is too long to decode");
  }
}

std::string decoder_versions() {
  return fmt::format("OpenImageIO {}.{}.{}, blosc {}, pugixml {}, Draco {}, meshoptimizer {}",
                     OIIO_VERSION_MAJOR, OIIO_VERSION_MINOR, OIIO_VERSION_PATCH,
                     BLOSC_VERSION_STRING, PUGIXML_VERSION, draco::kDracoVersion,
                     MESHOPTIMIZER_VERSION);
}

}  // namespace heliograph
