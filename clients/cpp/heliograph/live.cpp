#include "heliograph/live.h"

#include "wire/live.h"

namespace heliograph::client {

const Frame& Result::frame() const {
  if (error) throw ClientError(*error);
  return frames.front();
}

std::optional<Result> Results::next() { return call_->next(); }
void Results::close() { call_->close(); }

std::optional<Frame> Live::next() { return call_->next(); }
void Live::update(const RenderOptions& options) { call_->update(nullptr, options); }
void Live::update(const std::vector<Ref>& cameras, const RenderOptions& options) {
  call_->update(&cameras, options);
}
RenderOptions Live::options() const { return call_->options(); }
void Live::finish() { call_->finish(); }
void Live::close() { call_->close(); }

}  // namespace heliograph::client
