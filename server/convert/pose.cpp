// Matrices, poses and morph weights over time.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>

#include "kernels/ingest/take.h"
#include "renderer/base/parallel.h"
#include "renderer/scene/invertible.h"
#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

enum class Needs : u8 { kAffine, kInvertible };

constexpr std::size_t kNumbers = 16;  // numbers per matrix
constexpr std::size_t kGrain = 4096;  // matrices per thread at least

/// Reads one matrix; false: it is not finite, not affine, or not invertible where that is needed.
template <class T>
bool take(const T* m, Needs needs, mat4x3& out) {
  if (!kernels::take_affine(m, out)) return false;
  return needs == Needs::kAffine || kernels::plainly_invertible(out) || invertible(out);
}

template <class T>
bool take_all(std::span<const T> numbers, Needs needs, std::span<mat4x3> out) {
  std::atomic<bool> are_good = true;
  parallel_ranges(out.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    bool good = true;
    for (std::size_t i = begin; i < end; ++i)
      good &= take(numbers.data() + kNumbers * i, needs, out[i]);
    if (!good) are_good = false;
  });
  return are_good;
}

/// dims: {4, 4}, {N, 4, 4} or {N, M, 4, 4}, M known.
std::string matrix_path(const Dims& dims, u64 index) {
  if (dims.size() == 2) return "";
  if (dims.size() == 3) return indexed("", index);
  return fmt::format("[{}][{}]", index / *dims[1].size, index % *dims[1].size);
}

/// Returns the error of numbers that take_all() found invalid: the first not finite, else the first
/// matrix that is not affine, else the first not invertible.
Status why_not(const RawArray& numbers, const Dims& dims, std::span<const mat4x3> matrices) {
  const auto raw = to_f32(numbers, kNumbers);
  if (!raw) return std::unexpected(raw.error());
  mat4x3 affine;
  for (std::size_t i = 0; i < matrices.size(); ++i)
    if (const auto m = raw->as<float>().subspan(kNumbers * i, kNumbers);
        !kernels::take_affine(m.data(), affine))
      return fail(Code::kInvalidArgument, matrix_path(dims, i),
                  fmt::format("has the last row {} {} {} {}; give 0 0 0 1 (matrices are row-major "
                              "and act on column vectors)",
                              m[12], m[13], m[14], m[15]));
  const auto bad = std::ranges::find_if_not(matrices, invertible);
  return fail(Code::kInvalidArgument, matrix_path(dims, u64(bad - matrices.begin())),
              "is not invertible; give three independent axes of non-zero length (to hide an "
              "entity use visible = false)");
}

/// out   as many as the numbers make
Status convert(const RawArray& raw, const Dims& dims, Needs needs, std::span<mat4x3> out) {
  const bool are_good = raw.type == v1::D_TYPE_F32 ? take_all(raw.as<float>(), needs, out)
                                                   : take_all(raw.as<double>(), needs, out);
  return are_good ? Status() : why_not(raw, dims, out);
}

using Matrices = std::shared_ptr<mat4x3[]>;

/// Reads the matrices in place, without a copy. Null: that is not possible, or one of them is
/// invalid.
template <class T>
Expected<Matrices> convert_pieces(const v1::Array& array, ArraySource& source, u64 bytes) {
  constexpr u64 kBytes = kNumbers * sizeof(T);
  Matrices matrices;
  std::once_flag is_there;  // allocates with the first piece: the source has confirmed the size
  std::atomic<bool> are_good = true;
  const auto take = [&](u64 begin, std::span<const std::byte> piece) {
    std::call_once(is_there,
                   [&] { matrices = std::make_shared_for_overwrite<mat4x3[]>(bytes / kBytes); });
    const std::span numbers(reinterpret_cast<const T*>(piece.data()), piece.size() / sizeof(T));
    const std::span to(matrices.get() + begin / kBytes, piece.size() / kBytes);
    if (!take_all(numbers, Needs::kInvertible, to)) are_good = false;
  };
  const auto were_read = source.read(array, bytes, take);
  if (!were_read) return std::unexpected(were_read.error());
  return *were_read && are_good ? std::move(matrices) : nullptr;
}

Expected<Matrices> convert_copy(const v1::Array& array, ArraySource& source, const Dims& dims) {
  const auto raw = read_raw(array, source, dims, kFloatTypes);
  if (!raw) return std::unexpected(raw.error());
  const std::size_t count = raw->count / kNumbers;
  auto matrices = std::make_shared_for_overwrite<mat4x3[]>(count);
  HELIO_TRY(convert(*raw, dims, Needs::kInvertible, {matrices.get(), count}));
  return matrices;
}

Expected<std::vector<mat4x3>> read_vector(const v1::Array& array, ArraySource& source,
                                          const Dims& dims, Needs needs) {
  const auto raw = read_raw(array, source, dims, kFloatTypes);
  if (!raw) return std::unexpected(raw.error());
  std::vector<mat4x3> matrices(raw->count / kNumbers);
  HELIO_TRY(convert(*raw, dims, needs, matrices));
  return matrices;
}

/// {K, 4, 4} where there are times, else {4, 4}.
Dims keyed(std::size_t times, std::initializer_list<Dim> one) {
  Dims dims(one);
  if (times > 0) dims.insert(dims.begin(), Dim{"K", times});
  return dims;
}

}  // namespace

Expected<std::vector<mat4x3>> read_affine(const v1::Array& array, ArraySource& source,
                                          const Dims& dims) {
  return read_vector(array, source, dims, Needs::kAffine);
}

Expected<std::vector<mat4x3>> read_poses(const v1::Array& array, ArraySource& source,
                                         const Dims& dims) {
  return read_vector(array, source, dims, Needs::kInvertible);
}

Expected<ArrayOf<mat4x3>> read_many_poses(const v1::Array& array, ArraySource& source,
                                          const Dims& dims) {
  const auto bytes = bytes_of(array, dims, kFloatTypes);
  if (!bytes) return std::unexpected(bytes.error());
  const bool is_f32 = array.dtype() == v1::D_TYPE_F32;
  auto taken = source.take(array, *bytes, is_f32 ? Numbers::kPoses : Numbers::kPosesF64);
  if (!taken) return std::unexpected(std::move(taken).error());
  if (*taken) return ArrayOf<mat4x3>(*std::move(taken));
  auto matrices = is_f32 ? convert_pieces<float>(array, source, *bytes)
                         : convert_pieces<double>(array, source, *bytes);
  if (matrices && !*matrices) matrices = convert_copy(array, source, dims);
  if (!matrices) return std::unexpected(std::move(matrices).error());
  const u64 count = *bytes / dtype_size(array.dtype()) / kNumbers;
  const std::span all(matrices->get(), count);
  return ArrayOf<mat4x3>(std::make_shared<const Buffer>(*std::move(matrices), std::as_bytes(all)));
}

v1::Array to_array(std::span<const mat4x3> matrices, bool single, const ArraySink& sink) {
  std::vector<float> numbers;
  numbers.reserve(matrices.size() * 16);
  for (const mat4x3& m : matrices) {
    for (int row = 0; row < 3; ++row)
      for (int column = 0; column < 4; ++column) numbers.push_back(m[column][row]);
    numbers.insert(numbers.end(), {0, 0, 0, 1});
  }
  const std::vector<u64> shape =
      single ? std::vector<u64>{4, 4} : std::vector<u64>{matrices.size(), 4, 4};
  return to_array(std::move(numbers), shape, sink);
}

Expected<PosePatch> to_pose(const v1::Pose& message, ArraySource& source) {
  PosePatch patch;
  if (message.has_times()) HELIO_TAKE(patch.times, read_times(message.times(), source), "times");
  const Dims dims = keyed(patch.times.size(), {kFour, kFour});
  HELIO_TAKE(patch.matrices, read_poses(message.matrices(), source, dims), "matrices");
  if (patch.times.size() == 1) patch.times.clear();
  return patch;
}

v1::Pose to_proto(const PosePatch& pose, const ArraySink& sink) {
  v1::Pose message;
  const bool single = pose.times.empty();
  *message.mutable_matrices() = to_array(pose.matrices, single, sink);
  if (!single) {
    const u64 count = pose.times.size();
    *message.mutable_times() = to_array(pose.times, std::span(&count, 1), sink);
  }
  return message;
}

Expected<MorphWeights> to_morph_weights(const v1::MorphWeights& message, ArraySource& source) {
  MorphWeights out;
  if (message.has_times()) HELIO_TAKE(out.times, read_times(message.times(), source), "times");
  const Dims dims = keyed(out.times.size(), {{"T", {}}});
  ArrayOf<float> weights;
  HELIO_TAKE(weights, read_floats<float>(message.weights(), source, dims), "weights");
  if (weights.empty())
    return fail(Code::kInvalidArgument, "weights", "is empty; give one a morph target");
  out.weights.assign(weights.begin(), weights.end());
  if (out.times.size() == 1) out.times.clear();
  return out;
}

v1::MorphWeights to_proto(const MorphWeights& weights, const ArraySink& sink) {
  v1::MorphWeights message;
  const u64 count = weights.times.size();
  if (count == 0) {
    const u64 targets = weights.weights.size();
    *message.mutable_weights() = to_array(weights.weights, std::span(&targets, 1), sink);
    return message;
  }
  const u64 shape[] = {count, weights.weights.size() / count};
  *message.mutable_weights() = to_array(weights.weights, shape, sink);
  *message.mutable_times() = to_array(weights.times, std::span(&count, 1), sink);
  return message;
}

}  // namespace heliograph::server
