// Converts a result's region to domain types, checking every number and reference: the decode child
// is not trusted.
#pragma once

#include "server/decode/decoder.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// region  sent by the child; its arrays are used in place
/// job     provides the hash
/// paid    charge of the arrays, which they keep alive
/// Fails with the child's own refusal, or with INTERNAL when the result breaks a rule.
[[nodiscard]] Expected<Decoded> read_result(const std::shared_ptr<const Region>& region,
                                            const DecodeJob& job, std::shared_ptr<const void> paid);

}  // namespace heliograph::server
