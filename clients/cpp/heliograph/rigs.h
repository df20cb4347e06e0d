// Rigs of several cameras.
#pragma once

#include <string>

#include "heliograph/camera.h"
#include "heliograph/components.h"
#include "heliograph/edit.h"
#include "heliograph/handles.h"

namespace heliograph::client {

/// Two cameras side by side, and the entity that both are fixed to.
struct Rig {
  Entity root;
  Entity left;
  Entity right;
};

/// A rectified pair: the entity `name` and its children "name/left" and "name/right", which both
/// carry `camera`, look the same way, and lie `baseline` metres (> 0) apart along the image's x
/// axis, the root in the middle. Moving the root moves both. placement: components of the root.
/// With the plane "disparity:NAME/right" the left camera's disparity is fx * baseline / depth.
Rig stereo(Transaction& edit, const std::string& name, const Camera& camera, double baseline,
           const Components& placement);

}  // namespace heliograph::client
