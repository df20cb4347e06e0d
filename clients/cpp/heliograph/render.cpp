// Options that refer to more than a value.
#include "heliograph/render.h"

#include "heliograph/edit.h"
#include "wire/raw_stream.h"

namespace heliograph::client {

Cancellation::Cancellation() : state_(std::make_shared<wire::Cancelling>()) {}

void Cancellation::cancel() const { state_->cancel(); }

RenderOptions& RenderOptions::overlay(const Overlay& v) {
  fields_.overlay = v.draft();
  return *this;
}

}  // namespace heliograph::client
