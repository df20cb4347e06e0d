// Proto to domain and back for edits: the only place where both types meet. Every number is checked
// here; ids and names are not (apply() does that).
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "heliograph/v1/scene.pb.h"
#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "renderer/frame/lent_memory.h"
#include "renderer/scene/snapshot.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

/// Source of the bytes of a v1::Array, and of assets.
///
/// The daemon's resolves inline bytes, blobs by hash and the session's uploads; the decoder's
/// resolves `buffer` as a range of the result memfd.
class ArraySource {
 public:
  virtual ~ArraySource() = default;
  /// Returns the array's bytes, aligned for any dtype. The caller checks their number.
  [[nodiscard]] virtual Expected<BufferPtr> bytes(const v1::Array& array) = 0;
  /// Passes the bytes to `take` in pieces, as LentMemory::read(), where that spares a copy. False:
  /// it does not, or the array has another number of bytes, and nothing was passed.
  [[nodiscard]] virtual Expected<bool> read(const v1::Array&, u64 /*bytes*/, const TakePiece&) {
    return false;
  }
  /// As LentMemory::take() for the array; null where that is not possible.
  [[nodiscard]] virtual Expected<BufferPtr> take(const v1::Array&, u64 /*bytes*/, Numbers) {
    return nullptr;
  }
  /// Returns the asset of this hash, 32 bytes. NOT_FOUND.
  [[nodiscard]] virtual Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) = 0;
};

/// Destination of arrays: fills `array.source` for the given bytes; dtype and shape are set.
using ArraySink = std::function<void(const BufferPtr& bytes, v1::Array& array)>;

/// Parses and checks a transaction. INVALID_ARGUMENT names the field ("edits[3].mesh.indices[17]"),
/// what is wrong and the remedy; UNIMPLEMENTED names an unknown field by its path and number.
[[nodiscard]] Expected<Transaction> to_transaction(const v1::Transaction& message,
                                                   ArraySource& source);
/// The same; frees each edit of the message once it is read.
[[nodiscard]] Expected<Transaction> to_transaction(v1::Transaction&& message, ArraySource& source);
/// Inverse: to_transaction(to_proto(t)) equals t.
[[nodiscard]] v1::Transaction to_proto(const Transaction& transaction, const ArraySink& sink);
[[nodiscard]] v1::Edit to_proto(const Edit& edit, const ArraySink& sink);

/// Conversion of a pose or morph weights alone, for animations and Read.
[[nodiscard]] Expected<PosePatch> to_pose(const v1::Pose& message, ArraySource& source);
[[nodiscard]] v1::Pose to_proto(const PosePatch& pose, const ArraySink& sink);
[[nodiscard]] Expected<MorphWeights> to_morph_weights(const v1::MorphWeights& message,
                                                      ArraySource& source);
[[nodiscard]] v1::MorphWeights to_proto(const MorphWeights& weights, const ArraySink& sink);
/// Reads texels: (H, W) or (H, W, C), u8, u16, f16 or f32, finite.
[[nodiscard]] Expected<std::shared_ptr<const ImageData>> to_image(const v1::Array& texels,
                                                                  ArraySource& source);
[[nodiscard]] v1::Array to_proto(const ImageData& image, const ArraySink& sink);

/// Checks that a message and those in it have no field or enum value unknown to this version.
/// UNIMPLEMENTED with the path and number.
[[nodiscard]] Status check_known(const google::protobuf::Message& message);
/// The same for the message's own fields, not for the messages in them.
[[nodiscard]] Status check_own_fields(const google::protobuf::Message& message);

}  // namespace heliograph::server
