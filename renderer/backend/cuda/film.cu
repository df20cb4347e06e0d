// What becomes of samples: sums, planes, noise.
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

// A plane that samples made.
extern "C" __global__ void __launch_bounds__(kThreads)
    film_resolve(const __grid_constant__ ResolveLaunch l) {
  const u32 width = l.films->width, pixels = width * l.films->height;
  const u32 tiles = tiles_of(*l.films), across = tiles_across(*l.films);
  for (u64 i = thread(); i < u64(l.pictures) * pixels; i += threads()) {
    const u32 picture = u32(i / pixels), pixel = u32(i % pixels);
    const u32 tile = pixel / width / kTileSide * across + pixel % width / kTileSide;
    PlaneOut out = l.out;
    out.to = static_cast<std::byte*>(out.to) + picture * l.out_bytes;
    resolve_pixel(l.films[picture], out, pixel, l.tile_samples[picture * tiles + tile]);
  }
}

extern "C" __global__ void __launch_bounds__(kThreads)
    film_noise(const __grid_constant__ ResolveLaunch l) {
  for (u32 i = thread(); i < tiles_of(*l.films); i += threads())
    l.noise[i] = tile_noise(*l.films, i, l.tile_samples[i]);
}
