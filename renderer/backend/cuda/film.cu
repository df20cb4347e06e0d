// Uses of samples: sums, planes, noise.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

namespace {

/// The items of all pixels, into their films.
template <bool kMany>
__device__ void fold_all(const WaveLaunch& l) {
  const u32 pixels = pixels_of(l.work);
  u32 rays = 0;
  for (u32 i = thread(); i < pixels; i += threads()) {
    const WaveShot& shot = shot_of<kMany>(l, i);
    const BvhTracer tracer(shot.view.scene, shot.bvh);
    rays += Wave(shot.view, l.work, l.wave, tracer).fold(i);
  }
  add_up(rays, *l.rays);
}

}  // namespace

extern "C" __global__ void __launch_bounds__(kThreads)
    wave_fold(const __grid_constant__ WaveLaunch l) {
  fold_all<false>(l);
}
extern "C" __global__ void __launch_bounds__(kThreads)
    wave_fold_many(const __grid_constant__ WaveLaunch l) {
  fold_all<true>(l);
}

__device__ u32 tile_of(const FilmView& film, u32 pixel) {
  return pixel / film.width / kTileSide * tiles_across(film) + pixel % film.width / kTileSide;
}

// A plane that samples made.
extern "C" __global__ void __launch_bounds__(kThreads)
    film_resolve(const __grid_constant__ ResolveLaunch l) {
  const u32 pixels = l.films->width * l.films->height, tiles = tiles_of(*l.films);
  for (u64 i = thread(); i < u64(l.pictures) * pixels; i += threads()) {
    const u32 picture = u32(i / pixels), pixel = u32(i % pixels);
    PlaneOut out = l.out;
    out.to = static_cast<std::byte*>(out.to) + picture * l.out_bytes;
    const u32 tile = picture * tiles + tile_of(*l.films, pixel);
    resolve_pixel(l.films[picture], out, pixel, l.tile_samples[tile]);
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    film_noise(const __grid_constant__ ResolveLaunch l) {
  const u32 pixels = l.films->width * l.films->height;
  for (u32 i = thread(); i < pixels; i += threads())
    l.noise[i] = noise_statistics(*l.films, i, l.tile_samples[tile_of(*l.films, i)]);
}
