// The files of one load and how they refer to each other. No loader opens a file: what is not in
// the bundle does not exist.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "renderer/assets/load.h"

namespace heliograph::assets {

class Bundle {
 public:
  /// Refuses an empty bundle, and paths that are absolute or not clean. Only companions may begin
  /// with "..": whoever sends them has decided that they may be read.
  explicit Bundle(std::span<const BundleFile> files);

  [[nodiscard]] const BundleFile& model() const { return files_.front(); }
  /// Null where there is none, and for one that nobody has.
  [[nodiscard]] const BundleFile* find(std::string_view path) const;
  /// An empty file of the bundle: its sender states that nobody has it.
  [[nodiscard]] bool lacks(std::string_view path) const;

  /// The bundle path of `reference`, as written in the file `from`; `where` is for the message.
  /// A reference that is absolute, has a scheme or a NUL, or leaves the bundle is refused, in the
  /// same words whether or not such a file exists.
  [[nodiscard]] static std::string resolve(std::string_view from, std::string_view reference,
                                           const std::string& where);
  /// The same for formats whose programs write what they like: quotes, backslashes, paths of
  /// another machine, of which the last name is taken, ways out of the folder, bytes that are no
  /// UTF-8, which are read as Latin-1. "": `reference` is blank.
  [[nodiscard]] static std::string companion(std::string_view from, std::string_view reference,
                                             const std::string& where);

 private:
  [[nodiscard]] std::span<const BundleFile>::iterator at(std::string_view path) const;
  std::span<const BundleFile> files_;
};

/// Replaces %XX; refuses a broken escape.
[[nodiscard]] std::string percent_decode(std::string_view text, const std::string& where);

struct DataUri {
  std::string media_type;
  std::vector<std::byte> bytes;
};
/// data:[<media type>][;base64],<data>
[[nodiscard]] DataUri decode_data_uri(std::string_view uri, const std::string& where);

/// "dir/Name.GLTF" -> "gltf" and "Name".
[[nodiscard]] std::string extension_of(std::string_view path);
[[nodiscard]] std::string stem_of(std::string_view path);

/// Printable UTF-8 of at most `longest` bytes, whatever the file holds.
[[nodiscard]] std::string clean_text(std::string_view text, std::size_t longest);
/// A name for an object: at most 120 bytes, without '/'; `fallback` when nothing is left.
[[nodiscard]] std::string clean_name(std::string_view text, std::string_view fallback);

}  // namespace heliograph::assets
