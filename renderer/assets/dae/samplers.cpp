// Keys of animations, whatever lies between them, as keys with lines between them. Source: COLLADA
// 1.5.0, chapter 4 (curve interpolation), chapter 5 (sampler).
#include <algorithm>
#include <cmath>

#include "renderer/assets/dae/document.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr double kSplineStep = 1 / 60.0;  // seconds
constexpr double kMostSplineSteps = 64;   // of one segment
constexpr float kTurn = 10;               // degrees that keys of a turn are apart at most
constexpr float kMostTurnSteps = 4096;
constexpr float kJump = 1e-5f;  // seconds a STEP takes

/// A point of a cubic Bezier segment, whose controls do not turn back in time.
struct Bezier {
  double time[4], value[4];

  static double at(const double* p, double s) {
    const double r = 1 - s;
    return r * r * r * p[0] + 3 * r * r * s * p[1] + 3 * r * s * s * p[2] + s * s * s * p[3];
  }
  [[nodiscard]] double value_at(double t) const {
    constexpr int kHalvings = 40;
    double low = 0, high = 1;
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = 0.5 * (low + high);
      (at(time, middle) < t ? low : high) = middle;
    }
    return at(value, 0.5 * (low + high));
  }
  [[nodiscard]] bool is_straight() const {
    constexpr double kFlat = 1e-6;
    const double slope = (value[3] - value[0]) / (time[3] - time[0]);
    const double size = std::abs(value[3] - value[0]) + std::abs(value[0]);
    for (const int i : {1, 2})
      if (std::abs(value[0] + slope * (time[i] - time[0]) - value[i]) > kFlat * size) return false;
    return true;
  }
};

class Reader {
 public:
  Reader(const Document& document, Builder& builder, const Node& sampler, u32 width)
      : document_(document), builder_(builder), sampler_(sampler), width_(width) {
    out_.width = width;
  }

  std::optional<Curve> read(std::optional<u32> angle) {
    times_ = rows("INPUT", 1);
    values_ = rows("OUTPUT", width_);
    if (values_.size() != times_.size() * width_)
      refuse(place(sampler_), fmt::format("has {} times, but {} numbers, {} a key", times_.size(),
                                          values_.size(), width_));
    if (times_.empty()) return std::nullopt;
    read_kinds();
    read_tangents("IN_TANGENT", ins_);
    read_tangents("OUT_TANGENT", outs_);
    push(times_[0], value(0));
    std::size_t last = 0;
    for (std::size_t k = 1; k < times_.size(); ++k) {
      if (times_[k] > times_[last]) {
        add_segment(last, k, angle);
        last = k;
      } else {
        builder_.warn(
            fmt::format("{}: keys that are not behind those before are left out", place(sampler_)));
      }
    }
    return std::move(out_);
  }

 private:
  enum class Kind : u8 { kLinear, kStep, kBezier, kHermite };
  struct Tangents {
    std::vector<float> numbers;
    u32 each = 0;  // 2: a time and a value of each number, 1: the value; 0: there are none
  };

  std::vector<float> rows(const char* semantic, u32 width) {
    return read_rows(document_, needed_input(sampler_, semantic), width, builder_.budget);
  }

  void read_kinds() {
    kinds_.assign(times_.size(), Kind::kLinear);
    const Node input = input_of(sampler_, "INTERPOLATION");
    if (!input) return;
    const std::vector<std::string> names = read_names(document_, input, builder_.budget);
    if (names.size() < kinds_.size())
      refuse(place(sampler_), fmt::format("has {} keys, but {} names of INTERPOLATION",
                                          kinds_.size(), names.size()));
    for (std::size_t k = 0; k < kinds_.size(); ++k) kinds_[k] = kind_of(names[k]);
  }

  Kind kind_of(const std::string& name) {
    if (name == "BEZIER") return Kind::kBezier;
    if (name == "HERMITE") return Kind::kHermite;
    if (name == "STEP") return Kind::kStep;
    if (name != "LINEAR")
      builder_.warn(fmt::format("animations of {} are taken as LINEAR", clean_name(name, "?")));
    return Kind::kLinear;
  }

  void read_tangents(const char* semantic, Tangents& out) {
    const Node input = input_of(sampler_, semantic);
    const bool is_needed = std::ranges::any_of(
        kinds_, [](Kind kind) { return kind == Kind::kBezier || kind == Kind::kHermite; });
    if (!input || !is_needed) return;
    const Node source =
        document_.linked(input.attribute("source").value(), "source", place(sampler_));
    const Node accessor = source.child("technique_common").child("accessor");
    out.each = whole_attribute(accessor, "stride", width_) >= 2 * width_ ? 2 : 1;
    out.numbers = read_rows(document_, input, out.each * width_, builder_.budget);
    if (out.numbers.size() != times_.size() * out.each * width_)
      refuse(place(sampler_), fmt::format("has {} keys, but {} numbers of {}", times_.size(),
                                          out.numbers.size(), semantic));
  }

  [[nodiscard]] const float* value(std::size_t key) const { return &values_[key * width_]; }

  /// Curve of one number between two keys. A tangent that is absent points to the other key.
  [[nodiscard]] Bezier bezier(std::size_t from, std::size_t to, u32 column) const {
    const double t0 = times_[from], t3 = times_[to];
    const double v0 = value(from)[column], v3 = value(to)[column];
    Bezier out{{t0, t0 + (t3 - t0) / 3, t3 - (t3 - t0) / 3, t3},
               {v0, v0 + (v3 - v0) / 3, v3 - (v3 - v0) / 3, v3}};
    const bool is_hermite = kinds_[from] == Kind::kHermite;
    const auto take = [&](const Tangents& tangents, std::size_t key, int at) {
      if (tangents.each == 0) return;
      const float* numbers = &tangents.numbers[(key * width_ + column) * tangents.each];
      const double third = at == 1 ? 1.0 / 3 : -1.0 / 3;
      const double x = numbers[0], y = numbers[tangents.each - 1];
      if (tangents.each == 2) out.time[at] = is_hermite ? times_[key] + third * x : x;
      out.value[at] = is_hermite ? value(key)[column] + third * y : y;
    };
    take(outs_, from, 1);
    take(ins_, to, 2);
    for (const int i : {1, 2}) out.time[i] = std::clamp(out.time[i], t0, t3);
    return out;
  }

  void add_segment(std::size_t from, std::size_t to, std::optional<u32> angle) {
    const float start = times_[from], span = times_[to] - start;
    if (kinds_[from] == Kind::kStep) {
      push(times_[to] - std::min(kJump, span / 2), value(from));
      return push(times_[to], value(to));
    }
    const std::vector<Bezier> curves = curved(from, to);
    int pieces = 1;
    if (!curves.empty())
      pieces = int(std::clamp(std::ceil(span / kSplineStep), 2.0, kMostSplineSteps));
    if (angle) {
      const float turned = std::abs(value(to)[*angle] - value(from)[*angle]) / kTurn;
      pieces = std::max(pieces, int(std::min(std::ceil(turned), kMostTurnSteps)));
    }
    std::vector<float> numbers(width_);
    for (int i = 1; i < pieces; ++i) {
      const float u = float(i) / float(pieces);
      for (u32 c = 0; c < width_; ++c)
        numbers[c] = curves.empty() ? std::lerp(value(from)[c], value(to)[c], u)
                                    : float(curves[c].value_at(start + double(span) * u));
      push(start + span * u, numbers.data());
    }
    push(times_[to], value(to));
  }

  /// Curves by number; empty where lines are the same.
  [[nodiscard]] std::vector<Bezier> curved(std::size_t from, std::size_t to) const {
    std::vector<Bezier> curves;
    if (kinds_[from] == Kind::kLinear) return curves;
    for (u32 i = 0; i < width_; ++i) curves.push_back(bezier(from, to, i));
    if (std::ranges::all_of(curves, &Bezier::is_straight)) curves.clear();
    return curves;
  }

  void push(float time, const float* numbers) {
    if (!out_.times.empty() && time <= out_.times.back()) return;
    Budget::check(out_.times.size() + 1, builder_.options.limits.keys, "animation keys",
                  "animations");
    builder_.budget.take(1, (1 + width_) * sizeof(float), "animations");
    out_.times.push_back(time);
    out_.values.insert(out_.values.end(), numbers, numbers + width_);
  }

  const Document& document_;
  Builder& builder_;
  const Node sampler_;
  const u32 width_;
  std::vector<float> times_, values_;
  std::vector<Kind> kinds_;  // from each key to the next
  Tangents ins_, outs_;
  Curve out_;
};

}  // namespace

std::optional<Curve> read_curve(const Document& document, Builder& builder, const Node& sampler,
                                u32 width, std::optional<u32> angle) {
  return Reader(document, builder, sampler, width).read(angle);
}

}  // namespace heliograph::assets::dae
