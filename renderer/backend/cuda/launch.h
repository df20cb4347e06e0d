// Arguments of the GPU programs. Read by the .cu files beside it.
#pragma once

#include "kernels/bvh/bvh.h"
#include "kernels/label/probe.h"
#include "kernels/schedule/wave.h"

namespace heliograph::cuda {

using kernels::u32;
using kernels::u64;

inline constexpr u32 kThreads = 128;  // of a block, unless a program has others

/// Work of a round of programs, as counted by those before it. A round traces, with the rays
/// of light that the round before left, and lets arrive. Pairs are counted by one operation.
struct alignas(8) WaveRound {
  u32 active, lights;        // entries of WaveLaunch::active and of WaveLaunch::lit
  u32 hits, misses;          // of WaveLaunch::arrived: from its begin, and back from its end
  u32 next_ray, next_light;  // of the active and of the lit: which nobody took
};
struct WaveCounters {
  WaveRound rounds[2];  // by turns the present and the next one
};

inline constexpr u32 kMostWaves = 2;  // side by side
struct FilmCounters {
  WaveCounters waves[kMostWaves];
  u64 rays;  // of samples that were folded, and of centre planes
};

/// Scene and view that samples are taken of; everything lies in device memory.
struct WaveShot {
  kernels::ShotView view;
  kernels::BvhView bvh;
};

struct WaveLaunch {
  WaveShot shot;          // of the picture, or of the first one
  const WaveShot* shots;  // of programs for many pictures
  kernels::WaveWork work;
  kernels::WaveView wave;
  u32 round;       // which of WaveCounters::rounds; queues that are there twice go by it
  u32* active[2];  // items whose path goes on
  u32* arrived;    // those whose ray was traced, what met a surface first
  u32* lit;        // those whose light's ray is to be traced
  WaveCounters* counters;
  u64* rays;  // of the film
};

/// Films whose sums become planes or noise. Everything lies in device memory.
struct ResolveLaunch {
  const kernels::FilmView* films;  // of one size
  u32 pictures;
  const u32* tile_samples;  // of all films
  kernels::PlaneOut out;  // of film_resolve: of the first picture, whose pixels the others' follow
  u64 out_bytes;          // of a picture
  kernels::PixelStatistics* noise;  // of film_noise: by pixel of the first picture
};

/// One end of a probe: a scene and the camera in it.
struct ProbeEnd {
  kernels::SceneView scene;
  kernels::CameraView camera;
  kernels::BvhView bvh;
  bool camera_jumped;
  bool wanted;
};

/// Probe of a picture. In device memory.
struct ProbeLaunch {
  ProbeEnd now, forward, backward;
  kernels::CameraView disparity;
  bool wants_disparity;
  kernels::Settings settings;
  const kernels::RestBoxView* rest_boxes;
  kernels::FilmView film;
};

}  // namespace heliograph::cuda
