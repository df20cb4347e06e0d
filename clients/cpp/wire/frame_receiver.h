// The Render call. Other carriers of pixels (shared memory) belong here. Called by Scene::render.
#pragma once

#include <memory>
#include <vector>

#include "heliograph/render.h"
#include "heliograph/v1/render.pb.h"
#include "wire/session.h"

namespace heliograph::client::wire {

/// The final frames of a request, in the order of its cameras.
std::vector<Frame> render(const std::shared_ptr<Session>& session, const v1::RenderRequest& request,
                          const RenderOptions::Fields& options);

}  // namespace heliograph::client::wire
