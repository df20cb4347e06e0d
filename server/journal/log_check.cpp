// The log's pages and their checksums. See log_check.h.
#include "server/journal/log_check.h"

#include <fmt/format.h>

#include <cstring>
#include <fstream>
#include <string>
#include <string_view>

#include "renderer/base/types.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kHeader = 32;
constexpr std::size_t kFrameHeader = 24;
constexpr u32 kMagic = 0x377f0682;  // last bit set: checksums use big-endian words

u32 big_endian(std::string_view bytes, std::size_t at) {
  u32 word;
  std::memcpy(&word, bytes.data() + at, sizeof word);
  return __builtin_bswap32(word);
}

/// Cumulative checksum of the log: pairs of words, Fibonacci-weighted.
struct Sum {
  bool is_big_endian = false;
  u32 a = 0, b = 0;

  void add(std::string_view bytes) {
    for (std::size_t at = 0; at + 8 <= bytes.size(); at += 8) {
      a += word(bytes, at) + b;
      b += word(bytes, at + 4) + a;
    }
  }
  [[nodiscard]] bool is_at(std::string_view bytes, std::size_t at) const {
    return a == big_endian(bytes, at) && b == big_endian(bytes, at + 4);
  }

 private:
  [[nodiscard]] u32 word(std::string_view bytes, std::size_t at) const {
    const u32 big = big_endian(bytes, at);
    return is_big_endian ? big : __builtin_bswap32(big);
  }
};

/// Fills `bytes`; false: the file ends first.
bool read(std::ifstream& in, std::string& bytes) {
  return bool(in.read(bytes.data(), std::streamsize(bytes.size())));
}

}  // namespace

std::string check_log(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  const auto size = in.is_open() ? std::size_t(in.tellg()) : 0;
  if (size == 0) return "";
  in.seekg(0);
  std::string header(kHeader, '\0');
  const u32 magic = read(in, header) ? big_endian(header, 0) : 0;
  Sum sum{.is_big_endian = (magic & 1) != 0};
  if (magic != 0) sum.add(std::string_view(header).substr(0, 24));
  if ((magic & ~1u) != kMagic || !sum.is_at(header, 24))
    return fmt::format("the header of the log is damaged: all its {} bytes are dropped", size);
  const std::size_t page = big_endian(header, 8);
  if (page < 512 || page > 65'536) return "the log's page size is damaged: all of it is dropped";
  const std::string_view salts = std::string_view(header).substr(16, 8);
  const auto is_of_this = [&](std::string_view frame) { return frame.substr(8, 8) == salts; };
  std::string frame(kFrameHeader + page, '\0');
  std::size_t at = kHeader, dropped = 0;
  for (; read(in, frame); at += frame.size()) {
    const std::string_view view = frame;
    if (!is_of_this(view)) break;
    sum.add(view.substr(0, 8));
    sum.add(view.substr(kFrameHeader));
    if (!sum.is_at(view, 16)) break;
  }
  std::string head(kFrameHeader, '\0');
  for (std::size_t next = at; next + kFrameHeader <= size; next += frame.size()) {
    in.clear();
    in.seekg(std::streamoff(next));
    if (read(in, head) && is_of_this(head)) ++dropped;
  }
  if (dropped == 0) return "";
  return fmt::format("the log is damaged at byte {}: {} pages from there on are dropped", at,
                     dropped);
}

}  // namespace heliograph::server
