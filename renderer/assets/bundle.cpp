#include "renderer/assets/bundle.h"

#include <algorithm>
#include <charconv>
#include <filesystem>

#include "renderer/assets/refuse.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

using Path = std::filesystem::path;

constexpr std::size_t kLongestPath = 4096;
constexpr std::size_t kLongestName = 120;

[[noreturn]] void refuse_path(const std::string& where) {
  refuse(where,
         "a path must be relative and stay inside the bundle; put the file beside the model and "
         "refer to it by a relative path");
}

bool has_scheme(std::string_view path) {
  return path.substr(0, path.find('/')).find(':') != std::string_view::npos;
}

/// Resolves "." and ".." of a path, as written in the folder of the file `from`.
std::string normalise(std::string_view from, std::string_view path, const std::string& where,
                      bool may_leave = false) {
  if (path.empty() || path.size() > kLongestPath || path.front() == '/' || has_scheme(path) ||
      path.find('\0') != std::string_view::npos) {
    refuse_path(where);
  }
  std::string resolved = (Path(from).parent_path() / path).lexically_normal().string();
  if (resolved.ends_with('/')) resolved.pop_back();
  const bool leaves = *Path(resolved).begin() == "..";
  if (resolved == "." || (leaves && !may_leave)) refuse_path(where);
  return resolved;
}

int base64_digit(char c) {
  if (c >= 'A' && c <= 'Z') return c - 'A';
  if (c >= 'a' && c <= 'z') return c - 'a' + 26;
  if (c >= '0' && c <= '9') return c - '0' + 52;
  if (c == '+' || c == '-') return 62;
  if (c == '/' || c == '_') return 63;
  return -1;
}

std::vector<std::byte> decode_base64(std::string_view text, const std::string& where) {
  while (!text.empty() && text.back() == '=') text.remove_suffix(1);
  if (text.size() % 4 == 1) refuse(where, "base64 data is truncated");
  std::vector<std::byte> bytes;
  bytes.reserve(text.size() / 4 * 3 + 2);
  u32 bits = 0;
  int held = 0;
  for (char c : text) {
    const int digit = base64_digit(c);
    if (digit < 0) refuse(where, "a character that is not base64");
    bits = bits << 6 | u32(digit);
    held += 6;
    if (held >= 8) {
      held -= 8;
      bytes.push_back(std::byte(bits >> held & 0xff));
    }
  }
  return bytes;
}

/// Bytes of the UTF-8 sequence at the start of `text`; 0 when it is not one.
std::size_t utf8_length(std::string_view text) {
  const auto lead = u8(text.front());
  const std::size_t length = lead < 0x80            ? 1
                             : lead >> 5 == 0b110   ? 2
                             : lead >> 4 == 0b1110  ? 3
                             : lead >> 3 == 0b11110 ? 4
                                                    : 0;
  if (length == 0 || length > text.size()) return 0;
  u32 code = length == 1 ? lead : lead & (0x7fu >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((u8(text[i]) & 0xc0) != 0x80) return 0;
    code = code << 6 | (u8(text[i]) & 0x3f);
  }
  constexpr u32 kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xd800 && code < 0xe000;
  return code < kSmallest[length] || surrogate || code > 0x10ffff ? 0 : length;
}

/// Bytes that are no UTF-8 read as Latin-1.
std::string readable(std::string_view text) {
  std::string out;
  while (!text.empty()) {
    const std::size_t length = utf8_length(text);
    const auto c = u8(text.front());
    if (length > 0) {
      out += text.substr(0, length);
    } else {
      out += {char(0xc0 | c >> 6), char(0x80 | (c & 0x3f))};
    }
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return out;
}

/// The last name of a path.
std::string_view file_of(std::string_view path) { return path.substr(path.rfind('/') + 1); }

}  // namespace

Bundle::Bundle(std::span<const BundleFile> files) : files_(files) {
  if (files.empty()) refuse("files", "the bundle is empty; the first file is the model");
  for (std::size_t i = 0; i < files.size(); ++i) {
    const std::string where = fmt::format("files[{}].path", i);
    if (normalise("", files[i].path, where, i > 0) != files[i].path) refuse_path(where);
    if (&*at(files[i].path) != &files[i]) refuse(where, "this path is in the bundle twice");
  }
}

std::span<const BundleFile>::iterator Bundle::at(std::string_view path) const {
  return std::ranges::find(files_, path, &BundleFile::path);
}

const BundleFile* Bundle::find(std::string_view path) const {
  const auto found = at(path);
  return found == files_.end() || found->bytes.empty() ? nullptr : &*found;
}

bool Bundle::lacks(std::string_view path) const {
  const auto found = at(path);
  return found != files_.end() && found->bytes.empty();
}

std::string Bundle::resolve(std::string_view from, std::string_view reference,
                            const std::string& where) {
  return normalise(from, readable(reference), where);
}

std::string Bundle::companion(std::string_view from, std::string_view reference,
                              const std::string& where) {
  constexpr std::string_view kAround = " \t\r\n\"'";
  std::string path = readable(reference.substr(0, reference.find('\0')));
  std::ranges::replace(path, '\\', '/');
  path.erase(0, std::min(path.find_first_not_of(kAround), path.size()));
  path.erase(path.find_last_not_of(kAround) + 1);
  if (path.starts_with('/') || has_scheme(path)) path.erase(0, path.find_last_of("/:") + 1);
  if (path.empty()) return path;
  return normalise(from, path, where, true);
}

std::string percent_decode(std::string_view text, const std::string& where) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      result += text[i];
      continue;
    }
    u8 code = 0;
    const char* const digits = text.data() + i + 1;
    if (i + 2 >= text.size() || std::from_chars(digits, digits + 2, code, 16).ptr != digits + 2)
      refuse(where, "% is not followed by two hexadecimal digits");
    result += char(code);
    i += 2;
  }
  return result;
}

DataUri decode_data_uri(std::string_view uri, const std::string& where) {
  const std::size_t comma = uri.find(',');
  if (!uri.starts_with("data:") || comma == std::string_view::npos) {
    refuse(where, "a data URI reads data:<media type>;base64,<data>");
  }
  std::string_view header = uri.substr(5, comma - 5);
  const std::string_view body = uri.substr(comma + 1);
  if (header.ends_with(";base64")) {
    header.remove_suffix(7);
    return {std::string(header), decode_base64(body, where)};
  }
  const std::string text = percent_decode(body, where);
  const auto bytes = std::as_bytes(std::span(text));
  return {std::string(header), {bytes.begin(), bytes.end()}};
}

std::string extension_of(std::string_view path) {
  const std::string_view file = file_of(path);
  const std::size_t dot = file.rfind('.');
  return dot == file.npos ? "" : lower(file.substr(dot + 1));
}

std::string stem_of(std::string_view path) {
  const std::string_view file = file_of(path);
  return clean_name(file.substr(0, file.rfind('.')), "asset");
}

std::string clean_text(std::string_view text, std::size_t longest) {
  std::string result;
  while (!text.empty() && result.size() < longest) {
    const std::size_t length = utf8_length(text);
    const auto c = u8(text.front());
    if (length > 1) {
      result += text.substr(0, length);
    } else {
      result += length == 0 || c < 0x20 || c == 0x7f ? '_' : char(c);
    }
    text.remove_prefix(std::max<std::size_t>(length, 1));
  }
  return result;
}

std::string clean_name(std::string_view text, std::string_view fallback) {
  std::string result = clean_text(text, kLongestName);
  std::ranges::replace(result, '/', '_');
  return result.empty() ? std::string(fallback) : result;
}

}  // namespace heliograph::assets
