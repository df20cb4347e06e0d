#include "renderer/assets/load.h"

#include <OpenImageIO/oiioversion.h>
#include <assimp/version.h>
#include <basisu_transcoder_internal.h>
#include <blosc.h>
#include <draco/core/draco_version.h>
#include <fmt/ranges.h>
#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <pugixml.hpp>
#include <ranges>

#include "renderer/assets/builder.h"
#include "renderer/assets/content.h"
#include "renderer/assets/picture.h"
#include "renderer/assets/volume_file.h"

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

/// A format of models.
struct Format {
  std::string_view name;
  void (*load)(Builder&);
  /// Unit and axes that are taken for granted; "": files state them, or cannot.
  std::string_view assumed = "";
};
constexpr std::string_view kUpZ = ": a unit was taken as 1 m, and +Z as up";
constexpr std::array<Format, 14> kFormats = {{
    {"gltf", load_gltf},
    {"glb", load_gltf},
    {"obj", load_obj, kUpZ},
    {"dae", load_dae},
    {"ply", load_ply, kUpZ},
    {"stl", load_stl, kUpZ},
    {"nvdb", load_volume, kUpZ},
    {"vdb", load_volume, kUpZ},
    {"fbx", load_assimp},
    {"3ds", load_assimp, kUpZ},
    {"3mf", load_assimp},
    {"x", load_assimp, ": a unit was taken as 1 m, and +Y as up"},
    {"off", load_assimp, kUpZ},
    {"amf", load_assimp},
}};

/// Null: it is no format of models.
const Format* format_named(const std::string& name) {
  const auto* found = std::ranges::find(kFormats, name, &Format::name);
  return found == kFormats.end() ? nullptr : found;
}

std::string format_of(const Builder& builder) {
  const std::string& given = builder.options.format;
  return given.empty() ? extension_of(builder.bundle.model().path) : given;
}
bool is_gltf(const std::string& format) { return format == "gltf" || format == "glb"; }

/// Refuses axes and units for formats that state themselves what the numbers mean.
void refuse_axes(const LoadOptions& options, const char* message) {
  if (options.up.empty() && options.units <= 0) return;
  refuse(options.up.empty() ? "units" : "up", message);
}

/// A size that few models have: the unit may be another one.
void check_size(Builder& builder) {
  constexpr float kSmall = 1e-3f, kLarge = 1e3f;
  const vec3 sides = builder.loaded.bounds_max - builder.loaded.bounds_min;
  const float size = std::max({sides.x, sides.y, sides.z});
  if (size <= 0 || (size >= kSmall && size <= kLarge)) return;
  const std::string_view assumed = format_named(builder.format)->assumed;
  builder.warn(fmt::format("the model is {:.3g} m across{}{}", size, assumed,
                           assumed.empty() ? "" : ", unless given; units= and up= say others"));
}

std::string model_formats() {
  return fmt::format("{}", fmt::join(kFormats | std::views::transform(&Format::name), ", "));
}

/// Checks the request's options, whatever is in the file.
void check_options_of(const std::string& format, const LoadOptions& options) {
  const bool is_model = format_named(format) != nullptr;
  if (is_model && !options.layer.empty()) refuse("layer", "is of pictures; a model has none");
  if (!is_gltf(format) && !options.variant.empty()) {
    refuse_option("variant", "is of glTF (KHR_materials_variants); other files have none");
  }
  if (options.surface && format != "vdb" && format != "nvdb")
    refuse_option("surface", "is of level sets (.vdb, .nvdb); other files have none");
  if (!is_model) refuse_axes(options, "only models have it: leave it out");
  if (is_gltf(format)) {
    refuse_axes(options, "glTF is +Y up and in metres: leave it out, and give transform= instead");
  }
}

/// Format by the name, or by the bytes where they show another.
std::string checked_format(Builder& builder) {
  const std::string named = format_of(builder);
  const std::string format = format_of_content(builder.bundle.model().bytes);
  const bool is_same = format == named || (is_gltf(format) && is_gltf(named));
  if (is_same || !format_named(format)) return named;
  const bool is_asked = named == "ies" || !builder.options.format.empty() || is_picture_name(named);
  if (is_asked) return named;
  builder.warn(fmt::format("the file is {}, which its name does not say", format));
  return format;
}

void load(Builder& builder) {
  const std::string& format = builder.format;
  if (const Format* model = format_named(format)) return model->load(builder);
  if (format == "ies" || is_picture_name(format) || is_picture(builder.bundle.model().bytes)) {
    return load_picture(builder);
  }
  refuse_unimplemented("format",
                       fmt::format("'{}' is not one of {}, ies, {}", clean_name(format, ""),
                                   model_formats(), picture_formats()));
}

Loaded load_bundle(std::span<const BundleFile> files, const LoadOptions& options) {
  check_options(options);
  std::deque<std::string> texts;
  const std::vector<BundleFile> readable = in_utf8(files, texts);
  Builder builder(Bundle(readable), options);
  const std::string path = builder.bundle.model().path;
  builder.format = checked_format(builder);
  check_options_of(builder.format, options);
  try {
    load(builder);
    if (builder.complete()) {
      measure(builder.loaded);
      check_size(builder);
    }
  } catch (Refused& refused) {
    constexpr std::size_t kLongestMessage = 2000;
    Error& error = refused.error;
    error.message = clean_text(error.message, kLongestMessage);
    const std::string element = clean_text(error.where, kLongestMessage);
    if (!refused.is_option)
      error.where = clean_text(path, kLongestMessage) + (element.empty() ? "" : ": ") + element;
    throw;
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
  const std::string& format = builder.format;
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
  constexpr std::size_t kLongestPath = 2000;
  const std::string where = bundle.empty() ? "files" : clean_text(bundle[0].path, kLongestPath);
  try {
    return load_bundle(bundle, options);
  } catch (Refused& refused) {
    return std::unexpected(std::move(refused.error));
  } catch (const std::bad_alloc&) {
    return fail(Code::kResourceExhausted, where, "out of memory while decoding");
  } catch (const std::length_error&) {
    return fail(Code::kResourceExhausted, where, "an array is too long to decode");
  }
}

std::string decoder_versions() {
  return fmt::format(
      "OpenImageIO {}.{}.{}, Basis Universal {}.{}, {}, blosc {}, pugixml {}, Draco {}, "
      "meshoptimizer {}, assimp {}.{}.{}",
      OIIO_VERSION_MAJOR, OIIO_VERSION_MINOR, OIIO_VERSION_PATCH, BASISD_LIB_VERSION / 100,
      BASISD_LIB_VERSION % 100, openvdb_version(), BLOSC_VERSION_STRING, PUGIXML_VERSION,
      draco::kDracoVersion, MESHOPTIMIZER_VERSION, aiGetVersionMajor(), aiGetVersionMinor(),
      aiGetVersionPatch());
}

}  // namespace heliograph
