#include "heliograph/watch.h"

#include "wire/watch.h"

namespace heliograph::client {

std::optional<Change> Watch::next() { return call_->next(); }
std::uint64_t Watch::revision() const { return call_->revision(); }
void Watch::close() { call_->close(); }

}  // namespace heliograph::client
