#include "renderer/assets/content.h"

#include <OpenImageIO/strutil.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>

#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

constexpr std::size_t kLooked = 4096;  // bytes at the beginning

using Bytes = std::span<const std::byte>;

struct Magic {
  std::string_view bytes;
  const char* format;
};
constexpr std::array kMagics = std::to_array<Magic>({
    {"glTF", "glb"},
    {"ply\n", "ply"},
    {"ply\r", "ply"},
    {"Kaydara FBX Binary", "fbx"},
    {"; FBX", "fbx"},
    {"xof 03", "x"},
    {"OFF\n", "off"},
    {"OFF\r", "off"},
    {" BDV", "vdb"},
    {"NanoVDB", "nvdb"},
});

/// The count of facets gives the length of the file.
bool is_binary_stl(Bytes file) {
  constexpr std::size_t kHeader = 84, kFacet = 50;
  if (file.size() <= kHeader) return false;
  u32 facets;
  std::memcpy(&facets, file.data() + kHeader - sizeof facets, sizeof facets);
  return file.size() == kHeader + kFacet * u64(facets);
}

/// Statements that only OBJ has come first, and a vertex is one of them.
bool is_obj(std::string_view text) {
  constexpr std::array<std::string_view, 12> kKeys = {"v", "vt", "vn", "vp", "f",      "l",
                                                      "p", "g",  "o",  "s",  "usemtl", "mtllib"};
  Lines lines(text.substr(0, text.rfind('\n')));
  bool has_vertex = false;
  while (auto line = lines.next()) {
    const std::string_view key = take_word(*line);
    if (key.empty() || key.starts_with('#')) continue;
    if (std::ranges::find(kKeys, key) == kKeys.end()) return false;
    has_vertex = has_vertex || key == "v";
  }
  return has_vertex;
}

/// UTF-16 as UTF-8; "": it is none.
std::string utf8_of(Bytes bytes, bool is_big) {
  std::u16string units(bytes.size() / 2, u'\0');
  std::memcpy(units.data(), bytes.data(), 2 * units.size());
  if (is_big)
    for (char16_t& unit : units) unit = std::byteswap(unit);
  const bool is_text = bytes.size() % 2 == 0 && units.find(u'\0') == units.npos;
  return is_text ? OIIO::Strutil::utf16_to_utf8(units) : "";
}

}  // namespace

std::string format_of_content(Bytes bytes) {
  const std::string_view head = without_mark(as_text(bytes.first(std::min(kLooked, bytes.size()))));
  for (const Magic& magic : kMagics)
    if (head.starts_with(magic.bytes)) return magic.format;
  if (has_controls(head)) return is_binary_stl(bytes) ? "stl" : "";
  const std::string start = lower(trimmed(head).substr(0, 5));
  if (start == "solid" && lower(head).find("facet") != head.npos) return "stl";
  if (start == "<?xml" || start == "<coll")
    return head.find("<COLLADA") != head.npos ? "dae" : head.find("<amf") != head.npos ? "amf" : "";
  if (start.starts_with('{')) return "gltf";
  return is_obj(head) ? "obj" : "";
}

std::vector<BundleFile> in_utf8(std::span<const BundleFile> files, std::deque<std::string>& texts) {
  std::vector<BundleFile> out(files.begin(), files.end());
  for (BundleFile& file : out) {
    const std::string_view mark = as_text(file.bytes).substr(0, 2);
    if (mark != "\xFE\xFF" && mark != "\xFF\xFE") continue;
    std::string text = utf8_of(file.bytes.subspan(2), mark == "\xFE\xFF");
    if (!text.empty()) file.bytes = std::as_bytes(std::span(texts.emplace_back(std::move(text))));
  }
  return out;
}

}  // namespace heliograph::assets
