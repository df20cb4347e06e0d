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

/// Where the bytes of a v1::Array come from, and where assets are found.
///
/// The daemon's resolves inline bytes, blobs by hash and the session's uploads; the decoder's
/// resolves `buffer` as a range of the result memfd.
class ArraySource {
 public:
  virtual ~ArraySource() = default;
  /// The array's bytes, aligned for any dtype. How many there must be is checked by the caller.
  [[nodiscard]] virtual Expected<BufferPtr> bytes(const v1::Array& array) = 0;
  /// The same by pieces, where that spares a copy of all; false: it does not, or the array has
  /// another number of bytes, and nothing was taken. As LentMemory::read() has it.
  [[nodiscard]] virtual Expected<bool> read(const v1::Array&, u64 /*bytes*/, const TakePiece&) {
    return false;
  }
  /// The array's numbers as LentMemory::take() has them; null where it has not.
  [[nodiscard]] virtual Expected<BufferPtr> take(const v1::Array&, u64 /*bytes*/, Numbers) {
    return nullptr;
  }
  /// The asset of this hash (32 bytes), or NOT_FOUND.
  [[nodiscard]] virtual Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) = 0;
};

/// Where arrays go on their way out: fills `array.source` for the given bytes. dtype and shape are
/// set.
using ArraySink = std::function<void(const BufferPtr& bytes, v1::Array& array)>;

/// Parses and checks a transaction. INVALID_ARGUMENT names the field ("edits[3].mesh.indices[17]"),
/// what is wrong and the remedy; UNIMPLEMENTED names an unknown field by its path and number.
[[nodiscard]] Expected<Transaction> to_transaction(const v1::Transaction& message,
                                                   ArraySource& source);
/// The same, which frees each edit of the message when it has read it.
[[nodiscard]] Expected<Transaction> to_transaction(v1::Transaction&& message, ArraySource& source);
/// The inverse: to_transaction(to_proto(t)) equals t.
[[nodiscard]] v1::Transaction to_proto(const Transaction& transaction, const ArraySink& sink);
[[nodiscard]] v1::Edit to_proto(const Edit& edit, const ArraySink& sink);

/// A pose or morph weights on their own, for animations and Read.
[[nodiscard]] Expected<PosePatch> to_pose(const v1::Pose& message, ArraySource& source);
[[nodiscard]] v1::Pose to_proto(const PosePatch& pose, const ArraySink& sink);
[[nodiscard]] Expected<MorphWeights> to_morph_weights(const v1::MorphWeights& message,
                                                      ArraySource& source);
[[nodiscard]] v1::MorphWeights to_proto(const MorphWeights& weights, const ArraySink& sink);
/// A picture's texels: (H, W) or (H, W, C), u8, u16, f16 or f32, finite.
[[nodiscard]] Expected<std::shared_ptr<const ImageData>> to_image(const v1::Array& texels,
                                                                  ArraySource& source);
[[nodiscard]] v1::Array to_proto(const ImageData& image, const ArraySink& sink);

/// OK unless the message, or one inside it, carries a field or an enum value this version does not
/// know: UNIMPLEMENTED with its path and number.
[[nodiscard]] Status check_known(const google::protobuf::Message& message);
/// The same for the message's own fields, not for the messages in them.
[[nodiscard]] Status check_own_fields(const google::protobuf::Message& message);

}  // namespace heliograph::server
