// Photometric files of luminaires to pictures of their intensities. Chosen by load.cpp and by the
// lights of glTF.
//
// Source: ANSI/IES LM-63-19 and its versions of 1986, 1991, 1995 and 2002. The picture is what
// kernels/light/light_profile.h reads: rows by the vertical angle from 0 to 180 degrees, columns by
// the horizontal one.
#include <algorithm>
#include <cmath>

#include "renderer/assets/bundle.h"
#include "renderer/assets/picture.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

constexpr u32 kFinest = 1440;  // steps in 180 degrees of rows, and in 360 of columns
constexpr float kSameAngle = 1e-3f;

/// The numbers of a file, whatever separates them, and the line that each is in.
class Numbers {
 public:
  /// where: of the file in the document that holds it; empty: it is the document.
  Numbers(std::string_view text, const std::string& where)
      : rest_(without_mark(text)), file_(where) {}

  /// The next line, without its end; nullopt at the end of the file.
  [[nodiscard]] std::optional<std::string_view> line() {
    if (rest_.empty()) return std::nullopt;
    const std::size_t end = std::min(rest_.find('\n'), rest_.size());
    const std::string_view line = trimmed(rest_.substr(0, end));
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++line_;
    return line;
  }
  [[nodiscard]] float next(std::string_view what) {
    skip();
    const std::string_view word(rest_.begin(), std::ranges::find_if(rest_, separates));
    if (word.empty()) refuse(where(), fmt::format("the file ends before {}", what));
    const auto number = parse_number(word);
    if (!number)
      refuse(where(), fmt::format("{} is '{}', not a finite number", what, clean_name(word, "")));
    rest_.remove_prefix(word.size());
    return *number;
  }
  [[nodiscard]] float next(std::string_view what, float low) {
    const float number = next(what);
    if (!(number >= low)) refuse(where(), fmt::format("{} is {}, below {}", what, number, low));
    return number;
  }
  /// Number of things that follow; what remains of the file can hold them.
  [[nodiscard]] u32 count(std::string_view what) {
    const float number = next(what);
    if (!(number >= 1) || number != std::floor(number))
      refuse(where(), fmt::format("{} is {}, not a whole number from 1 on", what, number));
    if (2 * number > float(rest_.size() + 2))
      refuse(where(), fmt::format("{} is {}, more than the rest of the file holds", what, number));
    return u32(number);
  }
  void finish() {
    skip();
    if (!rest_.empty()) refuse(where(), "numbers follow the last candela value; remove them");
  }
  [[nodiscard]] std::string where() const {
    return fmt::format("{}{}line {}", file_, file_.empty() ? "" : ": ", line_ + 1);
  }

 private:
  static bool separates(char c) { return c == ',' || is_space(c); }
  void skip() {
    for (; !rest_.empty() && separates(rest_.front()); rest_.remove_prefix(1))
      line_ += rest_.front() == '\n';
  }
  std::string_view rest_;
  const std::string& file_;
  u64 line_ = 0;  // lines that ended
};

/// Contents of a file, its factors applied.
struct Profile {
  std::vector<float> vertical, horizontal;  // degrees, increasing
  std::vector<float> candela;               // vertical.size() for each horizontal angle
  std::vector<std::string> warnings;
};

/// True if the number after the ballast factor is a factor, too; later versions use it otherwise.
bool read_version(std::string_view line, const std::string& where) {
  if (line == "IESNA:LM-63-2002" || line == "IES:LM-63-2019") return false;
  if (line.starts_with("IES:") || line.starts_with("IESNA:")) {
    if (line != "IESNA:LM-63-1995")
      refuse_unimplemented(where, fmt::format("'{}': LM-63 of 1986, 1991, 1995, 2002 and 2019 "
                                              "are read",
                                              clean_name(line, "")));
  }
  return true;
}

/// Factors by the luminaire's tilt against the plumb line, which only who hangs it knows.
void skip_tilt(Numbers& file, Profile& out) {
  (void)file.next("the lamp-to-luminaire geometry");
  const u32 pairs = file.count("the number of tilt angles");
  for (u32 i = 0; i < 2 * pairs; ++i) (void)file.next("a tilt angle or factor");
  out.warnings.emplace_back(
      "TILT=INCLUDE: its factors are not applied; multiply profile_scale by that of the "
      "luminaire's tilt");
}

/// Up to and including the TILT line and what it announces. Returns what read_version() does.
bool read_head(Numbers& file, Profile& out) {
  const std::string first_where = file.where();
  std::optional<std::string_view> first;
  for (;;) {
    const std::string where = file.where();
    const auto line = file.line();
    if (!line) refuse(first_where, "is no IES file: no line begins with TILT=");
    if (!first) first = line;
    if (!line->starts_with("TILT=")) continue;
    const bool factor = read_version(*first, first_where);
    const std::string_view tilt = trimmed(line->substr(5));
    if (tilt == "INCLUDE") {
      skip_tilt(file, out);
    } else if (tilt != "NONE") {
      refuse_unimplemented(
          where, fmt::format("TILT={}, a file of its own; write TILT=NONE", clean_name(tilt, "")));
    }
    return factor;
  }
}

std::vector<float> read_angles(Numbers& file, u32 count, std::string_view what) {
  std::vector<float> angles;
  for (u32 i = 0; i < count; ++i) {
    angles.push_back(file.next(what));
    if (i > 0 && !(angles[i] > angles[i - 1]))
      refuse(file.where(), fmt::format("{} {} does not exceed the one before it", what, angles[i]));
  }
  return angles;
}

void check_range(const Numbers& file, const Profile& p) {
  const float top = p.vertical.front(), bottom = p.vertical.back();
  if ((top != 0 && top != 90) || (bottom != 90 && bottom != 180) || top == bottom)
    refuse(file.where(), fmt::format("the vertical angles go from {} to {}; type C has them from 0 "
                                     "or 90 to 90 or 180",
                                     top, bottom));
  const float from = p.horizontal.front(), to = p.horizontal.back();
  const bool half = from == 90 && to == 270;
  const bool other = from == 0 && (to == 0 || to == 90 || (to >= 180 && to <= 360));
  if (!half && !other)
    refuse(file.where(), fmt::format("the horizontal angles go from {} to {}; type C has them from "
                                     "0 to 0, 90, 180 or 360, or from 90 to 270",
                                     from, to));
}

Profile read_profile(const PictureSource& source) {
  Numbers file(as_text(source.bytes), source.where);
  Profile profile;
  const bool second_factor = read_head(file, profile);
  (void)file.next("the number of lamps", 1);
  (void)file.next("the lumens of a lamp");  // -1: absolute photometry
  float factor = file.next("the candela multiplier", 0);
  const u32 rows = file.count("the number of vertical angles");
  const u32 columns = file.count("the number of horizontal angles");
  const float type = file.next("the photometric type");
  if (type == 2 || type == 3)
    refuse_unimplemented(file.where(), fmt::format("photometric type {}; convert it to type C",
                                                   type == 2 ? "B" : "A"));
  if (type != 1) refuse(file.where(), fmt::format("the photometric type is {}, not 1 (C)", type));
  for (const char* what : {"the units of the size", "the width", "the length", "the height"})
    (void)file.next(what);
  factor *= file.next("the ballast factor", 0);
  const float second = file.next("the ballast-lamp photometric factor", 0);
  if (second_factor) factor *= second;
  (void)file.next("the input watts");
  profile.vertical = read_angles(file, rows, "the vertical angle");
  profile.horizontal = read_angles(file, columns, "the horizontal angle");
  check_range(file, profile);
  for (u64 i = 0; i < u64(rows) * columns; ++i) {
    profile.candela.push_back(file.next("a candela value", 0) * factor);
    if (!std::isfinite(profile.candela.back())) refuse(file.where(), "the candela are not finite");
  }
  file.finish();
  return profile;
}

// ---------------------------------------------------------------- sampling

/// The fewest even steps in `span` degrees that meet every angle; else kFinest.
u32 steps_of(const std::vector<float>& angles, float span) {
  const auto meets = [&](u32 steps) {
    return std::ranges::all_of(angles, [&](float angle) {
      const float place = angle / span * float(steps);
      return std::abs(place - std::round(place)) * span < kSameAngle * float(steps);
    });
  };
  u32 steps = 1;
  while (steps < kFinest && !meets(steps)) ++steps;
  return steps;
}

/// A place among increasing angles: between `first` and the one after it.
struct Place {
  std::size_t first = 0;
  float weight = 0;  // of the one after it
};
Place place_of(float angle, const std::vector<float>& angles) {
  const auto above = std::ranges::upper_bound(angles, angle);
  if (above == angles.begin()) return {};
  const std::size_t first = std::size_t(above - angles.begin()) - 1;
  if (above == angles.end()) return {first, 0};
  return {first, (angle - angles[first]) / (*above - angles[first])};
}

/// The horizontal angle in [0, 360) that a file with these symmetries has a value for.
float mirrored(float angle, float from, float to) {
  if (from == 90) return angle < 90 ? 180 - angle : angle > 270 ? 540 - angle : angle;
  if (to == 0) return 0;
  if (to > 180) return angle;
  if (angle > 180) angle = 360 - angle;
  return to == 90 && angle > 90 ? 180 - angle : angle;
}

class Sampled {
 public:
  explicit Sampled(const Profile& profile) : p_(profile) {
    // Without symmetry the first plane closes the circle.
    if (p_.horizontal.back() <= 180 || p_.horizontal.front() == 90) return;
    if (p_.horizontal.back() < 360) {
      p_.horizontal.push_back(360);
      p_.candela.insert(p_.candela.end(), p_.candela.begin(),
                        p_.candela.begin() + std::ptrdiff_t(p_.vertical.size()));
    }
  }
  /// Candela in a direction, degrees.
  [[nodiscard]] float at(float vertical, float horizontal) const {
    if (vertical < p_.vertical.front() - kSameAngle || vertical > p_.vertical.back() + kSameAngle)
      return 0;
    const Place row = place_of(vertical, p_.vertical);
    const Place column =
        place_of(mirrored(horizontal, p_.horizontal.front(), p_.horizontal.back()), p_.horizontal);
    const float a = within(row, column.first);
    return column.weight > 0 ? a + (within(row, column.first + 1) - a) * column.weight : a;
  }

 private:
  [[nodiscard]] float within(const Place& row, std::size_t column) const {
    const float* plane = p_.candela.data() + column * p_.vertical.size();
    const float a = plane[row.first];
    return row.weight > 0 ? a + (plane[row.first + 1] - a) * row.weight : a;
  }
  Profile p_;
};

}  // namespace

Picture decode_ies(const PictureSource& source) {
  const Profile profile = read_profile(source);
  const u32 rows = steps_of(profile.vertical, 180) + 1;
  const u32 columns = profile.horizontal.size() == 1 ? 1 : steps_of(profile.horizontal, 360);
  Canvas canvas(
      {.texels = nullptr, .width = columns, .height = rows, .channels = 1, .type = TexelType::kF32},
      source);
  const Sampled sampled(profile);
  for (u32 y = 0; y < rows; ++y) {
    auto* row = reinterpret_cast<float*>(canvas.row(y));
    const float vertical = 180 * float(y) / float(rows - 1);
    for (u32 x = 0; x < columns; ++x)
      row[x] = sampled.at(vertical, 360 * float(x) / float(columns));
  }
  Picture picture = std::move(canvas).finish(false);
  picture.warnings = profile.warnings;
  return picture;
}

}  // namespace heliograph::assets
