// The log's pages and their checksums. See log_check.h.
#include "server/journal/log_check.h"

#include <fmt/format.h>

#include <cstring>
#include <fstream>
#include <iterator>
#include <string_view>

#include "renderer/base/types.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kHeader = 32;
constexpr std::size_t kFrameHeader = 24;
constexpr u32 kMagic = 0x377f0682;  // its last bit: checksums read words as big-endian

u32 big_endian(std::string_view bytes, std::size_t at) {
  u32 word;
  std::memcpy(&word, bytes.data() + at, sizeof word);
  return __builtin_bswap32(word);
}

/// The running checksum of the log: pairs of words, Fibonacci-weighted.
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

}  // namespace

std::string check_log(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const std::string file{std::istreambuf_iterator<char>(in), {}};
  const std::string_view log = file;
  if (log.empty()) return "";
  const u32 magic = log.size() < kHeader ? 0 : big_endian(log, 0);
  Sum sum{.is_big_endian = (magic & 1) != 0};
  if (magic != 0) sum.add(log.substr(0, 24));
  if ((magic & ~1u) != kMagic || !sum.is_at(log, 24))
    return fmt::format("the header of the log is damaged: all its {} bytes are dropped",
                       log.size());
  const std::size_t page = big_endian(log, 8), frame = kFrameHeader + page;
  const std::string_view salts = log.substr(16, 8);
  if (page < 512 || page > 65'536) return "the log's page size is damaged: all of it is dropped";
  std::size_t at = kHeader;
  for (; at + frame <= log.size(); at += frame) {
    if (log.substr(at + 8, 8) != salts) break;
    sum.add(log.substr(at, 8));
    sum.add(log.substr(at + kFrameHeader, page));
    if (!sum.is_at(log, at + 16)) break;
  }
  std::size_t dropped = 0;
  for (std::size_t next = at; next + kFrameHeader <= log.size(); next += frame)
    if (log.substr(next + 8, 8) == salts) ++dropped;
  if (dropped == 0) return "";
  return fmt::format("the log is damaged at byte {}: {} pages from there on are dropped", at,
                     dropped);
}

}  // namespace heliograph::server
