#include "renderer/assets/load.h"

#include <cmath>
#include <cstddef>
#include <cstdio>
// jpeglib.h expects the two before it.
#include <OpenEXRConfig.h>
#include <blosc.h>
#include <jpeglib.h>
#include <png.h>
#include <tiffvers.h>
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

void load(Builder& builder) {
  const std::string& path = builder.bundle.model().path;
  const std::string format =
      builder.options.format.empty() ? extension_of(path) : builder.options.format;
  if (format == "gltf" || format == "glb") return load_gltf(builder);
  if (format == "dae") return load_dae(builder);
  if (format == "obj") return load_obj(builder);
  if (format == "ply") return load_ply(builder);
  if (format == "stl") return load_stl(builder);
  if (format == "nvdb" || format == "vdb") return load_volume(builder);
  if (format == "ies" || picture_format(format) != PictureFormat::kNone)
    return load_picture(builder);
  refuse_unimplemented(
      "format", fmt::format("'{}' is not one of gltf, glb, obj, ply, stl, dae, exr, hdr, png, "
                            "jpeg, tiff, nvdb, vdb, ies",
                            clean_name(format, "")));
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
                                    : decode_picture(file.bytes, format, where, builder.budget);
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
  return fmt::format("libpng {}, libjpeg {}, OpenEXR {}, libtiff of {}, blosc {}, pugixml {}",
                     PNG_LIBPNG_VER_STRING, JPEG_LIB_VERSION, OPENEXR_VERSION_STRING,
                     TIFFLIB_VERSION, BLOSC_VERSION_STRING, PUGIXML_VERSION);
}

}  // namespace heliograph
