// The C++ client of heliographd, whole. docs/cpp.md.
#pragma once

#include "heliograph/array.h"
#include "heliograph/camera.h"
#include "heliograph/client.h"
#include "heliograph/components.h"
#include "heliograph/edit.h"
#include "heliograph/error.h"
#include "heliograph/frame.h"
#include "heliograph/geometry.h"
#include "heliograph/handles.h"
#include "heliograph/light.h"
#include "heliograph/live.h"
#include "heliograph/material.h"
#include "heliograph/pose.h"
#include "heliograph/ref.h"
#include "heliograph/render.h"
#include "heliograph/scene.h"
