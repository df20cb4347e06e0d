#include "renderer/assets/curves.h"

#include <algorithm>
#include <cmath>

#include "renderer/assets/poses.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets {
namespace {

constexpr double kJump = 1e-5;  // seconds a STEP takes
constexpr double kSplineStep = 1 / 60.0;
constexpr int kMostSplineSteps = 64;  // of one segment

void slerp(const float* a, const float* b, float u, float* out) {
  const quat q = glm::slerp(quat(a[3], a[0], a[1], a[2]), quat(b[3], b[0], b[1], b[2]), u);
  out[0] = q.x, out[1] = q.y, out[2] = q.z, out[3] = q.w;
}

}  // namespace

void Curve::add_times(std::set<double>& out) const {
  for (std::size_t k = 0; k < times.size(); ++k) {
    out.insert(times[k]);
    if (k == 0) continue;
    const double span = double(times[k]) - times[k - 1];
    if (kind == Kind::kStep) out.insert(times[k] - std::min(kJump, span / 2));
    if (kind != Kind::kSpline) continue;
    const int steps = std::clamp(int(std::ceil(span / kSplineStep)), 2, kMostSplineSteps);
    for (int i = 1; i < steps; ++i) out.insert(times[k - 1] + span * i / steps);
  }
}

void Curve::evaluate(double time, float* out) const {
  const auto after = std::upper_bound(times.begin(), times.end(), float(time));
  const std::size_t next = std::size_t(after - times.begin());
  if (next == 0 || next == times.size()) {
    std::copy_n(value(next == 0 ? 0 : next - 1), width, out);
    return;
  }
  const std::size_t last = next - 1;
  const double span = double(times[next]) - times[last];
  const auto u = float((time - times[last]) / span);
  if (kind == Kind::kStep) {
    std::copy_n(value(last), width, out);
  } else if (kind == Kind::kLinear && rotation) {
    slerp(value(last), value(next), u, out);
  } else if (kind == Kind::kLinear) {
    for (u32 i = 0; i < width; ++i) out[i] = std::lerp(value(last)[i], value(next)[i], u);
  } else {
    const float u2 = u * u;
    const float u3 = u2 * u;
    for (u32 i = 0; i < width; ++i) {
      out[i] = (2 * u3 - 3 * u2 + 1) * value(last)[i] +
               float(span) * (u3 - 2 * u2 + u) * out_tangent(last)[i] +
               (3 * u2 - 2 * u3) * value(next)[i] + float(span) * (u3 - u2) * in_tangent(next)[i];
    }
  }
}

/// Our key times: strictly increasing, and counted.
std::vector<Time> Keys::times(std::initializer_list<const std::optional<Curve>*> curves) {
  std::set<double> all;
  for (const auto* curve : curves) {
    if (*curve) (*curve)->add_times(all);
  }
  add(all.size());
  std::vector<Time> out;
  for (const double time : all) {
    if (out.empty() || time > out.back()) out.push_back(time);
  }
  return out;
}

void Keys::add(u64 keys) {
  count_ += keys;
  Budget::check(count_, builder_.options.limits.keys, "animation keys", "animations");
}

PosePatch Keys::poses(const Rest& rest, const Track& track) {
  PosePatch patch{.times = times({&track.translation, &track.rotation, &track.scale}),
                  .matrices = {}};
  builder_.budget.take(patch.times.size(), sizeof(mat4x3) + sizeof(Time), "animations");
  for (const Time time : patch.times) {
    float t[3] = {rest.translation.x, rest.translation.y, rest.translation.z};
    float r[4] = {rest.rotation.x, rest.rotation.y, rest.rotation.z, rest.rotation.w};
    float s[3] = {rest.scale.x, rest.scale.y, rest.scale.z};
    if (track.translation) track.translation->evaluate(time, t);
    if (track.rotation) track.rotation->evaluate(time, r);
    if (track.scale) track.scale->evaluate(time, s);
    const quat rotation = unit_rotation(quat(r[3], r[0], r[1], r[2]), rest.where, builder_);
    const vec3 scale = visible_scale(rest.name, s);
    patch.matrices.push_back(compose_trs({t[0], t[1], t[2]}, rotation, scale));
    if (!invertible(patch.matrices.back()))
      refuse(rest.where, "is animated by a scale without an inverse");
  }
  if (patch.times.size() == 1) patch.times.clear();  // one key is a constant pose
  return patch;
}

vec3 Keys::visible_scale(const std::string& name, const float* s) {
  constexpr float kSmallest = 1e-4f;
  vec3 scale(s[0], s[1], s[2]);
  const float largest = std::max({std::abs(s[0]), std::abs(s[1]), std::abs(s[2]), 1.0f});
  for (int i = 0; i < 3; ++i) {
    if (std::abs(scale[i]) >= kSmallest * largest) continue;
    scale[i] = std::copysign(kSmallest * largest, scale[i]);
    builder_.warn(
        fmt::format("node '{}': a scale of 0 in an animation became {}", name, kSmallest));
  }
  return scale;
}

MorphWeights Keys::weights(const Curve& curve) {
  const std::optional<Curve> held = curve;
  MorphWeights result{.times = times({&held}), .weights = {}};
  const std::size_t count = result.times.size();
  builder_.budget.take(count, sizeof(float) * curve.width, "animations");
  result.weights.resize(count * curve.width);
  for (std::size_t k = 0; k < count; ++k) {
    curve.evaluate(result.times[k], result.weights.data() + k * curve.width);
  }
  if (count == 1) result.times.clear();
  return result;
}

}  // namespace heliograph::assets
