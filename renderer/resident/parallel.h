// Loops over the cores, under the name that the layers above know them by.
#pragma once

#include "renderer/base/parallel.h"

namespace heliograph::resident {

using heliograph::parallel_for;
using heliograph::parallel_invoke;
using heliograph::parallel_ranges;
using heliograph::run_alone;
using heliograph::run_in;

}  // namespace heliograph::resident
