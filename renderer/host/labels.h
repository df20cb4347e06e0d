// The label columns of a film. Called by backends.
#pragma once

#include "renderer/host/film.h"
#include "renderer/host/tracer.h"

namespace heliograph::host {

/// The columns of label_columns(), one row for each labelled instance. The film's centre planes are
/// complete in the host's memory. rays: of film.still().
///
/// Fails with RESOURCE_EXHAUSTED (more rows than asked for), and as the interrupt does.
[[nodiscard]] Expected<std::vector<Column>> labels(const HostFilm& film, const SceneRays& rays,
                                                   const Interrupt& interrupt);

}  // namespace heliograph::host
