#include "wire/companions.h"

#include <algorithm>
#include <system_error>

namespace heliograph::client::wire {
namespace {

namespace fs = std::filesystem;

/// Bytes of the UTF-8 sequence that begins at `i`; 0: none does.
std::size_t sequence(const std::string& text, std::size_t i) {
  const auto byte = [&](std::size_t k) { return k < text.size() ? (unsigned char)text[k] : 0U; };
  const unsigned lead = byte(i);
  const std::size_t size = lead < 0x80   ? 1
                           : lead < 0xC2 ? 0
                           : lead < 0xE0 ? 2
                           : lead < 0xF0 ? 3
                                         : 4;
  if (lead > 0xF4) return 0;
  for (std::size_t k = 1; k < size; ++k)
    if ((byte(i + k) & 0xC0U) != 0x80) return 0;
  const unsigned second = byte(i + 1);
  const bool overlong = (lead == 0xE0 && second < 0xA0) || (lead == 0xF0 && second < 0x90);
  const bool surrogate = lead == 0xED && second > 0x9F;
  const bool too_large = lead == 0xF4 && second > 0x8F;
  return overlong || surrogate || too_large ? 0 : size;
}

std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c - 'A' + 'a');
  return text;
}

/// Path in a folder whose name equals this one but for the case of letters; the first by its bytes.
std::optional<fs::path> same_name(const fs::path& folder, const std::string& name) {
  std::vector<fs::path> alike;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    if (lower(readable(at->path().filename().string())) == lower(name)) alike.push_back(at->path());
  const auto first = std::min_element(alike.begin(), alike.end());
  if (first == alike.end()) return std::nullopt;
  return *first;
}

/// The file itself, or the one whose path reads the same but for the case of letters.
std::optional<fs::path> on_disk(const fs::path& root, const fs::path& name) {
  std::error_code error;
  if (fs::is_regular_file(root / name, error)) return root / name;
  fs::path found = root;
  for (const fs::path& part : name) {
    const fs::path step = found / part;
    const bool is_there = part == ".." || fs::exists(step, error);
    found = is_there ? step : same_name(found, part.string()).value_or(step);
  }
  if (!fs::is_regular_file(found, error)) return std::nullopt;
  return found;
}

bool is_inside(const fs::path& path, const fs::path& folder) {
  std::error_code error;
  const fs::path inside = path.lexically_relative(fs::weakly_canonical(folder, error));
  return !inside.empty() && *inside.begin() != ".." && inside != ".";
}

}  // namespace

std::string readable(const std::string& name) {
  std::string out;
  for (std::size_t i = 0, size = 0; i < name.size(); i += std::max<std::size_t>(size, 1)) {
    size = sequence(name, i);
    if (size > 0) {
      out += name.substr(i, size);
      continue;
    }
    const auto byte = (unsigned char)name[i];
    out += {char(0xC0U | (byte >> 6U)), char(0x80U | (byte & 0x3FU))};
  }
  return out;
}

std::optional<fs::path> find_companion(const fs::path& folder, const std::string& name,
                                       const std::vector<std::string>& folders) {
  if (name.find('\0') != std::string::npos) return std::nullopt;
  std::vector<fs::path> roots{folder};
  roots.insert(roots.end(), folders.begin(), folders.end());
  const fs::path last = fs::path(name).filename();
  for (const fs::path& root : roots)
    for (const fs::path& relative :
         {fs::path(name).relative_path(), last, "materials/textures" / last, "textures" / last}) {
      const auto found = on_disk(root, relative);
      if (!found) continue;
      std::error_code error;
      const fs::path real = fs::weakly_canonical(*found, error);
      const auto allowed = [&](const fs::path& above) { return is_inside(real, above); };
      if (!error && std::any_of(roots.begin(), roots.end(), allowed)) return real;
    }
  return std::nullopt;
}

}  // namespace heliograph::client::wire
