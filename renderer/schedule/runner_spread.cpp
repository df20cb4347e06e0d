// One picture by several devices: what the job's own runner does, and what its helpers do.
#include "renderer/schedule/runner.h"

#include "kernels/scene/film.h"

namespace heliograph {

/// True if other devices would be asked. A film that stops by its time or its noise, or shows
/// passes, has steps that depend on the one before.
bool Runner::is_spread(const Film& film) const {
  const StopRule& stop = job_->stop;
  if (!context_.others || packed_ || job_->progressive) return false;
  if (stop.seconds > 0 || stop.noise > 0 || stop.adaptive) return false;
  return u64(film.tiles()) * kernels::kTilePixels * stop.spp >= context_.spread_samples;
}

/// The runs that nobody claims before are rendered here, so it takes no longer than without help.
Steps Runner::sample_spread(Film& film) {
  const auto spread = std::make_shared<Spread>(sampled_job(*job_), begun_.shots.front().camera,
                                               film.tiles(), film.tiles_across());
  struct Close {
    Spread& spread;
    ~Close() { spread.close(); }
  };
  const Close close{*spread};
  while (!spread->is_complete()) {
    context_.others->invite(spread);
    auto claim = Spread::claim(spread);
    if (claim) {
      HELIO_CO_TRY(co_await sample_run(film, claim->tiles()));
      claim->done();
    } else {
      spread->wait(slice().soon);
      HELIO_CO_TRY(co_await pause());
    }
    HELIO_CO_TRY(put_parts(film, *spread));
  }
  HELIO_CO_TRY(put_parts(film, *spread));
  co_return co_await emit(film, true);
}

Status Runner::put_parts(Film& film, Spread& spread) {
  for (const FilmPart& part : spread.collect()) {
    HELIO_TRY(film.put(part));
    const u64 taken = u64(part.tiles.count) * part.samples;
    tile_samples_ += taken;
    samples_ += taken * kernels::kTilePixels;
    helper_seconds_ += part.seconds;
    report(film, share_done(film), false);
  }
  return {};
}

/// All samples of the stop rule.
Steps Runner::sample_run(Film& film, TileRun run) {
  for (u32 done = 0; done < most_samples();) {
    const u32 count = next_pass(done);
    HELIO_CO_TRY(co_await pass(film, {run.first, run.first + run.count}, done, count));
    done += count;
  }
  co_return Status{};
}

Steps Runner::help() {
  HELIO_CO_TRY(co_await begin_camera(helped_->camera()));
  Film& film = *begun_.film;
  u64 rays = 0;
  double used = 0;
  for (;;) {
    auto claim = Spread::claim(helped_);
    if (!claim) co_return Status{};
    HELIO_CO_TRY(co_await sample_run(film, claim->tiles()));
    auto part = film.take(claim->tiles());
    if (!part) co_return std::unexpected(std::move(part).error());
    part->rays = film.rays() - rays;
    part->seconds = used_before_ + in_slice() - used;
    rays += part->rays;
    used += part->seconds;
    claim->deliver(*std::move(part));
  }
}

}  // namespace heliograph
