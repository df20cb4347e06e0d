// A decoded model as a message: what the decode child sends, and what the journal keeps.
#pragma once

#include <memory>
#include <string>

#include "server/convert/transaction.h"
#include "server/decode/decoded.pb.h"

namespace heliograph::server {

/// Sets name, library, entities and animations.
void write_asset(const Asset& asset, decode::Result& result, const ArraySink& sink);
/// The inverse; `hash` names the asset. INTERNAL when it breaks a rule.
[[nodiscard]] Expected<std::shared_ptr<const Asset>> read_asset(const decode::Result& result,
                                                                const std::string& hash,
                                                                ArraySource& source);
/// The error of a result that breaks a rule.
[[nodiscard]] std::unexpected<Error> broken(std::string what);

}  // namespace heliograph::server
