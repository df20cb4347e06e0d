// What becomes of samples: sums, planes, noise.
#include "renderer/backend/cuda/program.h"

using namespace heliograph::kernels;
using namespace heliograph::cuda;

// The items of all pixels, into the film.
extern "C" __global__ void __launch_bounds__(kThreads)
    wave_fold(const __grid_constant__ WaveLaunch l) {
  const BvhTracer tracer(l.shot.scene, l.bvh);
  const Wave wave(l.shot, l.work, l.wave, tracer);
  const u32 pixels = pixels_of(l.work);
  u32 rays = 0;
  for (u32 i = thread(); i < pixels; i += threads()) rays += wave.fold(i);
  add_up(rays, l.counters->rays);
}

// A plane that samples made.
extern "C" __global__ void __launch_bounds__(kThreads)
    film_resolve(const __grid_constant__ ResolveLaunch l) {
  const u64 pixels = u64(l.film.width) * l.film.height;
  for (u64 i = thread(); i < pixels; i += threads()) {
    const u32 x = u32(i % l.film.width), y = u32(i / l.film.width);
    const u32 tile = y / kTileSide * tiles_across(l.film) + x / kTileSide;
    resolve_pixel(l.film, l.out, i, l.tile_samples[tile]);
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    film_noise(const __grid_constant__ ResolveLaunch l) {
  const u32 tiles = tiles_across(l.film) * ((l.film.height + kTileSide - 1) / kTileSide);
  for (u32 i = thread(); i < tiles; i += threads())
    l.noise[i] = tile_noise(l.film, i, l.tile_samples[i]);
}
