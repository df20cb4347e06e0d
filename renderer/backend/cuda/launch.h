// What the host tells the GPU programs. Read by programs.cu.
#pragma once

#include "kernels/bvh.h"
#include "kernels/probe.h"
#include "kernels/wave.h"

namespace heliograph::cuda {

using kernels::u32;
using kernels::u64;

inline constexpr u32 kThreads = 128;  // of a block

/// The state of a wave that its programs change. A round of programs begins, traces, lets arrive
/// and lights.
struct WaveCounters {
  u32 next_item;  // of the work
  u32 active;     // entries of WaveLaunch::queue in this round
  u32 lights;     // and of WaveLaunch::light_queue
  u64 rays;       // of the samples that were folded
};

struct WaveLaunch {
  kernels::ShotView shot;
  kernels::BvhView bvh;
  kernels::WaveWork work;
  kernels::WaveView wave;
  u32 slots;
  u32* queue;        // slots
  u32* light_queue;  // slots
  WaveCounters* counters;
};

/// One end of a probe: a scene and the camera in it.
struct ProbeEnd {
  kernels::SceneView scene;
  kernels::CameraView camera;
  kernels::BvhView bvh;
  bool camera_jumped;
  bool wanted;
};

/// In device memory.
struct ProbeLaunch {
  ProbeEnd now, forward, backward;
  kernels::CameraView disparity;
  bool wants_disparity;
  kernels::Settings settings;
  kernels::FilmView film;
};

}  // namespace heliograph::cuda
