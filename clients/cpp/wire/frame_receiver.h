// The Render call: parts to frames, pixels copied once, from the wire into their array. What
// carries pixels otherwise (shared memory) belongs here. Called by Scene::render.
#pragma once

#include <vector>

#include "heliograph/render.h"
#include "heliograph/v1/render.pb.h"
#include "wire/session.h"

namespace heliograph::wire {

/// Ends calls from any thread.
class Cancelling {
 public:
  void cancel();
  void add(grpc::ClientContext* context);
  void remove(grpc::ClientContext* context);

 private:
  std::mutex mutex_;
  bool is_cancelled_ = false;
  std::set<grpc::ClientContext*> contexts_;
};

/// The final frames of a request, in the order of its cameras.
std::vector<Frame> render(Session& session, const v1::RenderRequest& request,
                          const RenderOptions::Fields& options);

}  // namespace heliograph::wire
