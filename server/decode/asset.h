// A decoded model as a message: sent by the decode child, stored by the journal.
#pragma once

#include <memory>
#include <string>

#include "server/convert/transaction.h"
#include "server/decode/decoded.pb.h"

namespace heliograph::server {

/// Fills in name, library, entities and animations of the result.
void write_asset(const Asset& asset, decode::Result& result, const ArraySink& sink);
/// Inverse of write_asset(). hash: becomes the asset's. INTERNAL when the message breaks a rule.
[[nodiscard]] Expected<std::shared_ptr<const Asset>> read_asset(const decode::Result& result,
                                                                const std::string& hash,
                                                                ArraySource& source);
/// Returns the error of a result that breaks a rule.
[[nodiscard]] std::unexpected<Error> broken(std::string what);

}  // namespace heliograph::server
