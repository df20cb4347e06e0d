#include "renderer/assets/ktx2_file.h"

#include <algorithm>
#include <cstring>

#include "renderer/assets/refuse.h"

namespace heliograph::assets {
namespace {

/// Reads numbers of a range, little end first.
class Fields {
 public:
  Fields(Bytes bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  [[nodiscard]] Bytes range(u64 offset, u64 size) const {
    if (offset > bytes_.size() || size > bytes_.size() - offset) {
      refuse(where_, "broken KTX2: the file is truncated");
    }
    return bytes_.subspan(offset, size);
  }
  template <class T>
  [[nodiscard]] T at(u64 offset) const {
    T value;
    std::memcpy(&value, range(offset, sizeof value).data(), sizeof value);
    return value;
  }
  [[nodiscard]] u32 word(u64 offset) const { return at<u32>(offset); }
  [[nodiscard]] u64 size() const { return bytes_.size(); }

 private:
  Bytes bytes_;
  const std::string& where_;
};

/// Format by the first block of the descriptor.
Ktx2Format format_of(const Fields& descriptor) {
  constexpr u64 kPrimaries = 13, kTransfer = 14, kFlags = 15;
  return {.primaries = descriptor.at<u8>(kPrimaries),
          .transfer = Ktx2Format::Transfer(descriptor.at<u8>(kTransfer)),
          .premultiplied = (descriptor.at<u8>(kFlags) & 1) != 0};
}

/// Each is a length, a key that ends with NUL, and a value, padded to four bytes.
std::map<std::string, std::string, std::less<>> values_of(const Fields& data) {
  std::map<std::string, std::string, std::less<>> values;
  for (u64 at = 0; at + 4 <= data.size();) {
    const u32 length = data.word(at);
    const Bytes bytes = data.range(at + 4, length);
    const std::string text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    const std::size_t end = std::min(text.find('\0'), text.size());
    const std::string value = text.substr(std::min(end + 1, text.size()));
    values.emplace(text.substr(0, end), value.substr(0, value.find('\0')));
    at += 4 + (u64(length) + 3) / 4 * 4;
  }
  return values;
}

}  // namespace

Ktx2File read_ktx2(const PictureSource& source) {
  constexpr u64 kLevels = 80;
  const Fields header(source.bytes, source.where);
  const Fields descriptor(header.range(header.word(48), header.word(52)), source.where);
  const Fields values(header.range(header.word(56), header.word(60)), source.where);
  return {.vk_format = header.word(12),
          .width = header.word(20),
          .height = header.word(24),
          .depth = header.word(28),
          .layers = header.word(32),
          .faces = header.word(36),
          .scheme = Ktx2Scheme(header.word(44)),
          .level = header.range(header.at<u64>(kLevels), header.at<u64>(kLevels + 8)),
          .unpacked_bytes = header.at<u64>(kLevels + 16),
          .format = format_of(descriptor),
          .values = values_of(values)};
}

}  // namespace heliograph::assets
