// A result's region to domain types, every number and reference in it checked: nothing that a
// decode child says is believed.
#pragma once

#include "server/decode/decoder.h"
#include "server/decode/wire.h"

namespace heliograph::server {

/// region  what the child sent; its arrays are used in place
/// job     for its hash
/// paid    what its arrays keep alive: the charge for them
/// Fails with the child's own refusal, or with INTERNAL when the result breaks a rule.
[[nodiscard]] Expected<Decoded> read_result(const std::shared_ptr<const Region>& region,
                                            const DecodeJob& job, std::shared_ptr<const void> paid);

}  // namespace heliograph::server
